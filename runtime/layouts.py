"""Every struct that Python and WGSL share, in the order of `shaders/structs.wgsl` (nested ones first).

After a change: `python -m runtime.structs`.
"""

from __future__ import annotations

from runtime.structs import GpuStruct

STRUCTS: tuple[type[GpuStruct], ...] = ()
