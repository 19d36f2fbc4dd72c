"""Which extensions are read, which change nothing that is read, and what to do about the rest."""

from __future__ import annotations

from collections import Counter
from typing import Any

from fit.gltf.container import Document
from fit.gltf.errors import printable
from fit.gltf.notes import Notes

READ = frozenset(
    {
        "EXT_mesh_gpu_instancing",
        "EXT_texture_avif",
        "EXT_texture_webp",
        "KHR_draco_mesh_compression",
        "KHR_lights_punctual",
        "KHR_materials_emissive_strength",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_materials_transmission",
        "KHR_materials_unlit",
        "KHR_mesh_quantization",
        "KHR_node_visibility",
        "KHR_texture_transform",
    }
)

# A file may list these as required, and still its triangles, base colours and emission are all there without.
HARMLESS = frozenset(
    {
        "EXT_lights_ies",
        "EXT_lights_image_based",
        "EXT_mesh_features",
        "EXT_mesh_manifold",
        "EXT_structural_metadata",
        "GODOT_single_root",
        "KHR_animation_pointer",
        "KHR_audio_emitter",
        "KHR_implicit_shapes",
        "KHR_interactivity",
        "KHR_materials_anisotropy",
        "KHR_materials_clearcoat",
        "KHR_materials_diffuse_transmission",
        "KHR_materials_dispersion",
        "KHR_materials_ior",
        "KHR_materials_iridescence",
        "KHR_materials_sheen",
        "KHR_materials_specular",
        "KHR_materials_variants",
        "KHR_materials_volume",
        "KHR_node_hoverability",
        "KHR_node_selectability",
        "KHR_physics_rigid_bodies",
        "KHR_xmp",
        "KHR_xmp_json_ld",
        "MSFT_lod",
        "OMI_physics_body",
        "OMI_physics_joint",
        "OMI_physics_shape",
        "OMI_seat",
        "OMI_vehicle_body",
        "OMI_vehicle_wheel",
    }
)

# Reported where they are met: a fallback may stand beside them.
MESHOPT_EXTENSIONS = ("EXT_meshopt_compression", "KHR_meshopt_compression")
BASISU_EXTENSION = "KHR_texture_basisu"

CONVERSIONS = {
    "EXT_meshopt_compression": "npx @gltf-transform/cli copy in.glb out.glb",
    "KHR_meshopt_compression": "npx @gltf-transform/cli copy in.glb out.glb",
    "KHR_texture_basisu": "npx @gltf-transform/cli ktxdecompress in.glb out.glb",
    "EXT_texture_webp": "npx @gltf-transform/cli png in.glb out.glb",
    "EXT_texture_avif": "npx @gltf-transform/cli png in.glb out.glb",
}


def extension_remedy(name: str) -> str:
    """What the user can do about an extension that can't be read: the command that converts the file."""
    if name in CONVERSIONS:
        return f"{name} is not supported; convert the file with `{CONVERSIONS[name]}`"
    return f"the file requires the unknown extension {name}; export the file without it"


def check_required(document: Document) -> None:
    """Refuse a file that requires what can't be read.

    Raises:
        GltfError: it names the extension and the command that converts the file.
    """
    for i, name in enumerate(document.extensions_required):
        if name not in READ and name not in HARMLESS:
            raise document.root.error(extension_remedy(name), f"extensionsRequired[{i}]")


def note_ignored(document: Document, notes: Notes) -> None:
    """List every extension that is not read, with the number of places that use it."""
    uses = _count_extension_objects(document.root.values)
    for name in sorted(uses.keys() | set(document.extensions_used)):
        if name not in READ and name not in MESHOPT_EXTENSIONS and name != BASISU_EXTENSION:
            notes.ignore(f"extension {name}", max(uses[name], 1))


def _count_extension_objects(root: Any) -> Counter[str]:
    """How often each extension is used anywhere in the JSON; iterative, the nesting is not ours to trust."""
    found: Counter[str] = Counter()
    waiting = [root]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            extensions = value.get("extensions")
            if isinstance(extensions, dict):
                found.update(map(printable, extensions))
            waiting.extend(child for child in value.values() if isinstance(child, (dict, list)))
        elif value and isinstance(value[0], (dict, list)):
            waiting.extend(child for child in value if isinstance(child, (dict, list)))
    return found
