"""glTF 2.0 file -> `fit.scene.Scene`; drops nothing in silence."""

from fit.gltf.errors import GltfError
from fit.gltf.loader import load

__all__ = ["GltfError", "load"]
