"""``python -m sb3_piano``, the same as the command ``sb3-piano``."""

import sys

from sb3_piano.cli import main

if __name__ == "__main__":
    sys.exit(main())
