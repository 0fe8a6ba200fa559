"""`python -m cosim` is the command `cosim`."""

import os
import sys

if sys.path[0] == os.getcwd():  # `-m` puts the current folder first: a numpy.py that lies there is not NumPy
    sys.path.append(sys.path.pop(0))

from cosim.cli import main

if __name__ == "__main__":
    main()
