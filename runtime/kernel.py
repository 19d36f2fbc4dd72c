"""Kernels: a WGSL file with its pipeline, dispatched or drawn with its resources bound by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import wgpu

from runtime import wgsl
from runtime.binding import Resource, layout_entry, mismatch
from runtime.device import Gpu
from runtime.resources import Buffer
from runtime.wgsl import Binding, WgslError

if TYPE_CHECKING:
    from runtime.encoder import Recorder

__all__ = ["MAX_WORKGROUPS", "Kernel", "RasterKernel", "Resource", "compile_module", "vertex_layouts"]

Constants = Mapping[str, float]

MAX_WORKGROUPS = 65535  # on each axis, by WebGPU


class _Program:
    """What compute and raster kernels share: the shader, its explicit layouts, and binding by name."""

    def __init__(
        self,
        gpu: Gpu,
        name: str,
        stages: tuple[str, ...],
        constants: Constants,
        aliases: Mapping[str, str],
        root: Path,
    ) -> None:
        self.gpu = gpu
        self.name = name
        self.shader = wgsl.load(name, aliases, root)
        self.constants = _check_constants(self.shader, constants)
        self.module = compile_module(gpu, self.shader)
        self._groups: list[tuple[Any, tuple[Binding, ...]]] = []
        count = max((binding.group for binding in self.shader.bindings), default=-1) + 1
        for group in range(count):
            bindings = tuple(binding for binding in self.shader.bindings if binding.group == group)
            entries = [layout_entry(binding, stages) for binding in bindings]
            self._groups.append((gpu.bind_groups.layout(entries), bindings))
        self.layout = gpu.wgpu_device.create_pipeline_layout(
            bind_group_layouts=[layout for layout, _ in self._groups], label=name
        )
        self.binding_names = tuple(binding.name for binding in self.shader.bindings)
        self._slots = [tuple(binding.index for binding in bindings) for _, bindings in self._groups]

    def _stage(self, entry: str) -> dict[str, Any]:
        return {"module": self.module, "entry_point": entry, "constants": self.constants}

    def _bind(
        self, encoder: Any, shared: Sequence[Mapping[str, Resource]], own: Mapping[str, Resource]
    ) -> None:
        """Sets the pass's bind groups. Raises TypeError for what is missing, unknown or unfit."""
        given = self._collect(shared, own)
        for index, (layout, bindings) in enumerate(self._groups):
            resources = tuple(given[binding.name] for binding in bindings)
            for binding, resource in zip(bindings, resources, strict=True):
                fault = mismatch(binding, resource, self.gpu.features)
                if fault:
                    raise TypeError(f"{self.name}: {binding.name} is a {binding.type}, {fault}")
            encoder.set_bind_group(index, self.gpu.bind_groups.group(layout, self._slots[index], resources))

    def _collect(
        self, shared: Sequence[Mapping[str, Resource]], own: Mapping[str, Resource]
    ) -> dict[str, Resource]:
        names = f"it binds {', '.join(self.binding_names) or 'nothing'}"
        unknown = [name for name in own if name not in self.binding_names]
        if unknown:
            raise TypeError(f"{self.name} binds no {', '.join(unknown)}; {names}")
        given: dict[str, Resource] = {}
        for mapping in (*shared, own):
            given.update(mapping)
        missing = [name for name in self.binding_names if name not in given]
        if missing:
            raise TypeError(f"{self.name} needs {', '.join(missing)}; {names}")
        return given


class Kernel(_Program):
    """The compute kernel `shaders/<name>.wgsl`, whose entry point is `main`.

    `constants` sets its `override`s, `aliases` its import aliases. Raises WgslError, naming file and line,
    when it does not compile, and ValueError for a constant that it does not have.
    """

    def __init__(
        self,
        gpu: Gpu,
        name: str,
        *,
        constants: Constants | None = None,
        aliases: Mapping[str, str] | None = None,
        root: Path = wgsl.SHADERS,
    ) -> None:
        super().__init__(gpu, name, ("compute",), constants or {}, aliases or {}, root)
        size = self.shader.workgroup_size_with(self.constants)
        if size is None or "compute" not in self.shader.entry_points:
            raise WgslError(f"{self.shader.locate(1)}: {name} has no @compute entry point")
        self.workgroup_size = size
        try:
            self.pipeline = gpu.wgpu_device.create_compute_pipeline(
                layout=self.layout, compute=self._stage(self.shader.entry_points["compute"]), label=name
            )
        except wgpu.GPUError as error:
            raise WgslError(self.shader.explain(str(error))) from error

    def groups_for(self, x: int, y: int = 1, z: int = 1) -> tuple[int, int, int]:
        """Workgroups that cover x * y * z invocations."""
        a, b, c = (-(-count // size) for count, size in zip((x, y, z), self.workgroup_size, strict=True))
        return a, b, c

    def dispatch(
        self,
        compute_pass: Any,
        groups: int | Sequence[int],
        /,
        *shared: Mapping[str, Resource],
        **bindings: Resource,
    ) -> None:
        """Runs `groups` workgroups with resources bound by name.

        `shared` dicts (the world's, the frame's) may hold more than the kernel binds; the keywords may not.
        Raises TypeError for a name that is missing or unknown and for a resource that does not fit its
        declaration, ValueError for more workgroups than WebGPU allows.
        """
        counts = (groups,) if isinstance(groups, int | np.integer) else tuple(groups)
        x, y, z = (int(count) for count in (*counts, 1, 1)[:3])
        if max(x, y, z) > MAX_WORKGROUPS or min(x, y, z) < 0:
            raise ValueError(
                f"{self.name}: {x} x {y} x {z} workgroups;"
                f" WebGPU allows {MAX_WORKGROUPS} on an axis: use two axes"
            )
        compute_pass.set_pipeline(self.pipeline)
        self._bind(compute_pass, shared, bindings)
        compute_pass.dispatch_workgroups(x, y, z)

    def dispatch_pass(
        self,
        rec: Recorder,
        size: Sequence[int],
        /,
        *shared: Mapping[str, Resource],
        **bindings: Resource,
    ) -> None:
        """A compute pass of its own under the kernel's name, an invocation for each of `size`; see
        `dispatch`."""
        with rec.compute(self.name) as compute_pass:
            self.dispatch(compute_pass, self.groups_for(*size), *shared, **bindings)

    def dispatch_indirect(
        self,
        compute_pass: Any,
        groups: Buffer,
        offset: int = 0,
        /,
        *shared: Mapping[str, Resource],
        **bindings: Resource,
    ) -> None:
        """`dispatch` with the three counts read from a buffer of usage `indirect`."""
        compute_pass.set_pipeline(self.pipeline)
        self._bind(compute_pass, shared, bindings)
        compute_pass.dispatch_workgroups_indirect(groups.wgpu_buffer, offset)


class RasterKernel(_Program):
    """The raster kernel `shaders/<name>.wgsl`: entry points `vertex_main` and, for colours, `fragment_main`.

    `targets`: a format for each colour target, or wgpu's dict (format, blend, write_mask). `depth`: the
    format of the depth target, or None. `vertex_buffers`: a structured dtype for each buffer, whose fields
    take the shader locations 0, 1, ... in order, through all buffers; or wgpu's dict. `cull`: none, front or
    back; counter-clockwise triangles show their front. Errors as in `Kernel`.
    """

    def __init__(
        self,
        gpu: Gpu,
        name: str,
        targets: Sequence[str | Mapping[str, Any]] = (),
        depth: str | None = "depth32float",
        vertex_buffers: Sequence[Any] = (),
        cull: str = "none",
        *,
        topology: str = "triangle-list",
        depth_write: bool = True,
        depth_compare: str = "less",
        depth_bias: int = 0,
        depth_bias_slope_scale: float = 0.0,
        constants: Constants | None = None,
        aliases: Mapping[str, str] | None = None,
        root: Path = wgsl.SHADERS,
    ) -> None:
        super().__init__(gpu, name, ("vertex", "fragment"), constants or {}, aliases or {}, root)
        entries = self.shader.entry_points
        if "vertex" not in entries or (targets and "fragment" not in entries):
            raise WgslError(
                f"{self.shader.locate(1)}: {name} needs a @vertex and, with targets, a @fragment entry point"
            )
        fragment = None
        if "fragment" in entries:
            colors = [{"format": target} if isinstance(target, str) else dict(target) for target in targets]
            fragment = {**self._stage(entries["fragment"]), "targets": colors}
        depth_stencil = None
        if depth is not None:
            depth_stencil = {
                "format": depth,
                "depth_write_enabled": depth_write,
                "depth_compare": depth_compare,
                "depth_bias": depth_bias,
                "depth_bias_slope_scale": depth_bias_slope_scale,
            }
        try:
            self.pipeline = gpu.wgpu_device.create_render_pipeline(
                layout=self.layout,
                vertex={**self._stage(entries["vertex"]), "buffers": vertex_layouts(vertex_buffers)},
                primitive={"topology": topology, "front_face": "ccw", "cull_mode": cull},
                depth_stencil=depth_stencil,
                fragment=fragment,
                label=name,
            )
        except wgpu.GPUError as error:
            raise WgslError(self.shader.explain(str(error))) from error

    def bind(self, render_pass: Any, /, *shared: Mapping[str, Resource], **bindings: Resource) -> None:
        """Makes the pass draw with this kernel and these resources; errors as in `Kernel.dispatch`."""
        render_pass.set_pipeline(self.pipeline)
        self._bind(render_pass, shared, bindings)


def compile_module(gpu: Gpu, shader: wgsl.Shader) -> Any:
    """The shader's module. Raises WgslError naming the original file and line."""
    try:
        return gpu.wgpu_device.create_shader_module(code=shader.code, label=shader.name)
    except wgpu.GPUError as error:
        raise WgslError(shader.explain(str(error))) from error


def vertex_layouts(buffers: Sequence[Any]) -> list[dict[str, Any]]:
    """wgpu's vertex buffer layouts of structured dtypes; dicts pass through."""
    layouts: list[dict[str, Any]] = []
    location = 0
    for buffer in buffers:
        if isinstance(buffer, Mapping):
            layouts.append(dict(buffer))
            location += len(buffer["attributes"])
            continue
        dtype = np.dtype(buffer)
        attributes = []
        for field in dtype.names or ():
            base, offset = dtype.fields[field][:2]
            attributes.append({"format": _vertex_format(base), "offset": offset, "shader_location": location})
            location += 1
        layouts.append({"array_stride": dtype.itemsize, "step_mode": "vertex", "attributes": attributes})
    return layouts


def _vertex_format(dtype: np.dtype) -> str:
    base, shape = dtype.subdtype or (dtype, ())
    kind = {"f": "float", "u": "uint", "i": "sint"}[base.kind]
    count = int(np.prod(shape, dtype=int))
    return f"{kind}{base.itemsize * 8}" + (f"x{count}" if count > 1 else "")


def _check_constants(shader: wgsl.Shader, constants: Constants) -> dict[str, float]:
    known = [override.name for override in shader.overrides]
    unknown = [name for name in constants if name not in known]
    if unknown:
        raise ValueError(
            f"{shader.name} has no override {', '.join(unknown)}; it has {', '.join(known) or 'none'}"
        )
    needed = [
        entry.name for entry in shader.overrides if entry.default is None and entry.name not in constants
    ]
    if needed:
        raise ValueError(f"{shader.name} needs a value for the override {', '.join(needed)}")
    return {name: float(value) for name, value in constants.items()}
