"""Twin of shaders/lib/half.wgsl: where 16-bit floats end."""

import numpy as np

HALF_LARGEST = float(np.finfo(np.float16).max)
HALF_BOUND = 6.0e4
