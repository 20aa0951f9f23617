"""``python -m sb3_piano.cli`` is ``sb3-piano``."""

import sys

from sb3_piano.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
