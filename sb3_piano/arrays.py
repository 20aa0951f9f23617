"""Type aliases of NumPy arrays by element type; shapes and units are documented at each use."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
Float32Array = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]
Arrays = dict[str, npt.NDArray[Any]]
"""Arrays by name."""
FingerArray = npt.NDArray[np.int8]
"""Labels of fingers: 0 to 9, -1 for none."""
