"""Records a frame's passes and submits them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from runtime.device import Gpu
from runtime.resources import Buffer, Texture, TextureView
from runtime.timing import Timer

Color = tuple[float, float, float, float]
Target = Texture | TextureView


class Recorder:
    """A command encoder with its timer.

    rec = Recorder(gpu, timer)
    with rec.compute("sdfddgi/update_probes") as p:
        kernel.dispatch(p, kernel.groups_for(count), world.bindings(), probes=probes)
    rec.submit()
    """

    def __init__(self, gpu: Gpu, timer: Timer | None = None, label: str = "frame") -> None:
        self.gpu = gpu
        self.timer = timer or Timer(gpu)
        self.encoder = gpu.wgpu_device.create_command_encoder(label=label)

    @contextmanager
    def compute(self, label: str) -> Iterator[Any]:
        """A timed compute pass."""
        with self.timer.compute_pass(self.encoder, label) as compute_pass:
            yield compute_pass

    @contextmanager
    def render(
        self,
        label: str,
        colors: Sequence[Target] = (),
        depth: Target | None = None,
        *,
        clear_color: Color | Sequence[Color] | None = (0.0, 0.0, 0.0, 0.0),
        clear_depth: float | None = 1.0,
    ) -> Iterator[Any]:
        """A timed render pass into mip 0 of `colors` and `depth`.

        They are cleared first, `clear_color` being one colour for all targets or one for each; None keeps
        what is there.
        """
        clears = _colors(clear_color, len(colors))
        attachments = [
            _attachment(_target_view(target), clear) for target, clear in zip(colors, clears, strict=True)
        ]
        depth_attachment = None
        if depth is not None:
            depth_attachment = {
                "view": _target_view(depth),
                "depth_load_op": "load" if clear_depth is None else "clear",
                "depth_clear_value": 1.0 if clear_depth is None else clear_depth,
                "depth_store_op": "store",
            }
        with self.timer.render_pass(self.encoder, label, attachments, depth_attachment) as render_pass:
            yield render_pass

    def clear(self, buffer: Buffer) -> None:
        """Sets the whole buffer to zero."""
        self.encoder.clear_buffer(buffer.wgpu_buffer)

    def copy_buffer(self, source: Buffer, destination: Buffer, size: int | None = None) -> None:
        """Copies the first `size` bytes (all of the source)."""
        self.encoder.copy_buffer_to_buffer(
            source.wgpu_buffer, 0, destination.wgpu_buffer, 0, source.size if size is None else size
        )

    def copy_texture(self, source: Texture, destination: Texture) -> None:
        """Copies mip 0 between textures of one size and format."""
        self.encoder.copy_texture_to_texture(
            {"texture": source.wgpu_texture}, {"texture": destination.wgpu_texture}, source.size
        )

    def submit(self) -> None:
        """Hands the recorded passes to the GPU. The recorder is then spent."""
        self.gpu.queue.submit([self.encoder.finish()])


def _target_view(target: Target) -> Any:
    return target.view(mip=0).binding if isinstance(target, Texture) else target.binding


def _colors(clear: Color | Sequence[Color] | None, count: int) -> list[Color | None]:
    if clear is None:
        return [None] * count
    if not clear or isinstance(clear[0], int | float):
        return [clear] * count  # type: ignore[list-item]
    return list(clear)  # type: ignore[arg-type]


def _attachment(view: Any, clear: Color | None) -> dict[str, Any]:
    if clear is None:
        return {"view": view, "load_op": "load", "store_op": "store"}
    return {"view": view, "load_op": "clear", "clear_value": clear, "store_op": "store"}
