"""What a WGSL declaration asks for: its entry in the bind group layout, and whether a resource fits it."""

from __future__ import annotations

from typing import Any

import wgpu

from runtime import formats
from runtime.resources import Buffer, Sampler, Texture, TextureView
from runtime.wgsl import Binding

Resource = Buffer | Texture | TextureView | Sampler


def layout_entry(binding: Binding, stages: tuple[str, ...]) -> dict[str, Any]:
    """wgpu's layout entry, visible in these stages (compute; vertex and fragment)."""
    writes = binding.access in ("write", "read_write")
    # Vertex shaders that write need a feature of their own; ours only read.
    visible = ("fragment",) if writes and "fragment" in stages else stages
    visibility = 0
    for stage in visible:
        visibility |= getattr(wgpu.ShaderStage, stage.upper())
    entry: dict[str, Any] = {"binding": binding.index, "visibility": visibility}
    match binding.kind:
        case "uniform":
            entry["buffer"] = {"type": "uniform"}
        case "storage":
            entry["buffer"] = {"type": "storage" if writes else "read-only-storage"}
        case "sampler":
            entry["sampler"] = {"type": "comparison" if binding.comparison else "filtering"}
        case "storage_texture":
            access = {"read": "read-only", "write": "write-only", "read_write": "read-write"}[
                binding.access or ""
            ]
            entry["storage_texture"] = {
                "access": access,
                "format": binding.format,
                "view_dimension": binding.dimension,
            }
        case "texture":
            entry["texture"] = {
                "sample_type": binding.sample_type,
                "view_dimension": binding.dimension,
                "multisampled": binding.multisampled,
            }
    return entry


def mismatch(binding: Binding, resource: Any, features: frozenset[str]) -> str | None:
    """Why the resource does not fit the declaration, or None."""
    expected = {"uniform": Buffer, "storage": Buffer, "sampler": Sampler}.get(
        binding.kind, Texture | TextureView
    )
    if not isinstance(resource, expected):
        return f"not a {type(resource).__name__}"
    if isinstance(resource, Buffer):
        needed = wgpu.BufferUsage.UNIFORM if binding.kind == "uniform" else wgpu.BufferUsage.STORAGE
        return (
            None
            if resource.usage & needed
            else f"but the buffer {resource.label!r} lacks usage {binding.kind!r}"
        )
    if isinstance(resource, Sampler):
        return None if resource.is_comparison == binding.comparison else "so mind the sampler's `compare`"
    assert isinstance(resource, Texture | TextureView)
    return _texture_mismatch(binding, resource, features)


def _texture_mismatch(
    binding: Binding, texture: Texture | TextureView, features: frozenset[str]
) -> str | None:
    what = f"texture {texture.label!r}"
    if texture.dimension != binding.dimension:
        return f"not {texture.dimension} like {what}"
    if binding.kind == "storage_texture":
        if not texture.usage & wgpu.TextureUsage.STORAGE_BINDING:
            return f"but {what} lacks usage 'storage'"
        return None if texture.format == binding.format else f"not {texture.format} like {what}"
    if not texture.usage & wgpu.TextureUsage.TEXTURE_BINDING:
        return f"but {what} lacks usage 'sample'"
    have = formats.lookup(texture.format).sample_type
    if have == "unfilterable-float" and "float32-filterable" in features:
        have = "float"
    fits = have == binding.sample_type or (binding.sample_type, have) in (
        ("unfilterable-float", "float"),
        ("unfilterable-float", "depth"),
    )
    if fits:
        return None
    if have == "unfilterable-float":
        return f"which is sampled, and this device cannot filter {texture.format} of {what}: use textureLoad"
    return f"not {texture.format} like {what}"
