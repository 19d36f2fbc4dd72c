"""The WGSL export: it compiles, and on a GPU it gives the distances and colours of the float64 twin."""

from __future__ import annotations

import re

import numpy as np
import pytest
import wgpu

from fit import export, rotation, sdf
from fit.primitives import (
    PrimitiveSet,
    make_box,
    make_cylinder,
    make_half_space,
    make_plane,
    make_sphere,
)

MAIN = """
@group(0) @binding(0) var<storage, read> points: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> results: array<vec4f>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (id.x < arrayLength(&points)) {
        let p = points[id.x].xyz;
        let m = map_material(p);
        results[2u * id.x] = vec4f(m.albedo, map(p));
        results[2u * id.x + 1u] = vec4f(m.emission, 0.0);
    }
}
"""


@pytest.fixture(scope="module")
def device():
    try:
        return wgpu.gpu.request_adapter_sync().request_device_sync()
    except (RuntimeError, AttributeError) as error:
        pytest.skip(f"no GPU adapter ({error}); install mesa-vulkan-drivers")


def every_kind() -> PrimitiveSet:
    rng = np.random.default_rng(4)
    turns = rotation.normalized(rng.normal(size=(4, 4)))
    return PrimitiveSet.concatenate(
        [
            make_box((1, 0, 0), (1, 2, 0.5), turns[0], rng.random((6, 3)), rng.random((6, 3)) * 9),
            make_box((-2, 1, 0), (1, 1, 1), albedo=(0.25, 0.5, 1)),
            make_sphere((0, 2, 1), 0.7, (0.9, 0.1, 0.2), (1e-3, 0, 3e4)),
            make_cylinder((0, 0, -2), 0.3, 2.0, turns[1], rng.random((6, 3))),
            make_plane((0, -1, 2), 3, 2, 0.02, turns[2], rng.random((6, 3))),
            make_half_space((0, -2, 0), (0, 0, 0, 1), (0.3, 0.3, 0.3)),
        ]
    )


def evaluate(device, source: str, points: np.ndarray) -> np.ndarray:
    """map and map_material at points (p, 3): (p, 2, 4) float32, rows (albedo, distance), (emission, 0)."""
    padded = np.zeros((len(points), 4), np.float32)
    padded[:, :3] = points
    given = device.create_buffer_with_data(data=padded, usage=wgpu.BufferUsage.STORAGE)
    found = device.create_buffer(
        size=32 * len(points), usage=wgpu.BufferUsage.STORAGE | wgpu.BufferUsage.COPY_SRC
    )
    module = device.create_shader_module(code=source + MAIN)
    pipeline = device.create_compute_pipeline(
        layout="auto", compute={"module": module, "entry_point": "main"}
    )
    bindings = [{"binding": i, "resource": {"buffer": b}} for i, b in enumerate((given, found))]
    group = device.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=bindings)
    encoder = device.create_command_encoder()
    compute = encoder.begin_compute_pass()
    compute.set_pipeline(pipeline)
    compute.set_bind_group(0, group)
    compute.dispatch_workgroups(-(-len(points) // 64))
    compute.end()
    device.queue.submit([encoder.finish()])
    return np.frombuffer(device.queue.read_buffer(found), np.float32).reshape(-1, 2, 4)


def test_it_agrees_with_the_twin(device, tmp_path):
    primitives = every_kind()
    export.write(primitives, tmp_path / "set.wgsl")
    points = np.random.default_rng(0).uniform(-4, 4, (4000, 3)).astype(np.float32)
    found = evaluate(device, (tmp_path / "set.wgsl").read_text(), points)
    each = sdf.distance(primitives, points)
    d, index = sdf.union_distance(primitives, points)
    np.testing.assert_allclose(found[:, 0, 3], d, atol=5e-6)
    face = sdf.primitive_face(primitives, points, index)
    # Where two primitives, or two faces, are equally near, float32 may take the other.
    ordered = np.sort(each, axis=1)
    clear = ordered[:, 1] - ordered[:, 0] > 1e-4
    same = np.all(np.abs(found[:, 0, :3] - primitives.albedo[index, face]) < 1e-6, axis=1)
    assert same[clear].mean() > 0.999
    assert set(index[same].tolist()) == set(range(6))
    np.testing.assert_allclose(
        found[same][:, 1, :3], primitives.emission[index, face][same], rtol=1e-6, atol=1e-9
    )


def test_nothing_is_far_and_black(device, tmp_path):
    export.write(PrimitiveSet.empty(), tmp_path / "none.wgsl")
    found = evaluate(device, (tmp_path / "none.wgsl").read_text(), np.zeros((1, 3)))
    assert found[0, 0].tolist() == pytest.approx([0, 0, 0, 3e38]) and not found[0, 1].any()


def test_extreme_sizes_are_valid_literals(device, tmp_path):
    needles = PrimitiveSet.concatenate(
        [
            make_box((1e5, 0, 0), (1e5, 10, 10)),
            make_cylinder((0, 1e-4, 0), 1e-5, 1e-1),
            make_sphere((0, 0, -7e-5), 1e-4),
        ]
    )
    export.write(needles, tmp_path / "set.wgsl")
    points = np.array([[1e5, 9, 0], [0, 0.06, 0], [0, 0, 0]], np.float32)
    found = evaluate(device, (tmp_path / "set.wgsl").read_text(), points)
    np.testing.assert_allclose(found[:, 0, 3], sdf.union_distance(needles, points)[0], rtol=1e-4)


def test_numbers_beyond_float32_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"beyond WGSL's float32"):
        export.write(make_box((1e39, 0, 0)), tmp_path / "set.wgsl")


def test_every_number_reads_back_to_the_same_float32(tmp_path):
    primitives = every_kind()
    export.write(primitives, tmp_path / "set.wgsl")
    text = (tmp_path / "set.wgsl").read_text()
    vectors = re.findall(r"p - vec3f\(([^)]*)\)|to_local\(p, vec3f\(([^)]*)\)", text)
    centers = np.array([[float(v) for v in (a or b).split(",")] for a, b in vectors], np.float32)
    np.testing.assert_array_equal(centers, np.tile(primitives.positions.astype(np.float32), (2, 1)))
