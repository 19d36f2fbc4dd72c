"""KHR_draco_mesh_compression through DracoPy, the extra `draco`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fit.gltf.container import Document
from fit.gltf.json_object import JsonObject
from fit.gltf.resources import Resources

DRACO_EXTENSION = "KHR_draco_mesh_compression"


@dataclass(frozen=True)
class DracoMesh:
    """Decoded values by attribute name, before normalisation, (n, components), and triangles (m, 3)."""

    attributes: dict[str, NDArray[Any]]
    triangles: NDArray[np.uint32]


def decode(document: Document, resources: Resources, extension: JsonObject) -> DracoMesh:
    """Decode the compressed data of one primitive.

    Raises:
        GltfError: DracoPy is not installed, or the data is damaged.
    """
    try:
        import DracoPy
    except ImportError as error:
        what = f'{DRACO_EXTENSION} needs the package DracoPy; install it with `pip install "sdfprim[draco]"`'
        raise extension.error(what) from error
    view = extension.required_reference("bufferView", len(document.buffer_views), "bufferViews")
    data = bytes(resources.buffer_view(view))
    try:
        mesh = DracoPy.decode(data)
        triangles = np.asarray(mesh.faces, np.uint32).reshape(-1, 3)
    except Exception as error:  # DracoPy raises bare exceptions of several kinds on damaged data
        raise extension.error(f"the compressed data is damaged ({error}); export the file again") from error
    return DracoMesh(_attributes(extension, mesh), triangles)


def _attributes(extension: JsonObject, mesh: Any) -> dict[str, NDArray[Any]]:
    ids = extension.object("attributes")
    if ids is None:
        raise extension.error("required but missing", "attributes")
    decoded = {attribute["unique_id"]: attribute["data"] for attribute in mesh.attributes}
    found = {}
    for name in ids.values:
        unique_id = ids.integer(name)
        if unique_id not in decoded:
            raise ids.error(f"the compressed data has no attribute {unique_id}; export the file again", name)
        values = np.asarray(decoded[unique_id])
        found[name] = values.reshape(len(values), -1)
    return found
