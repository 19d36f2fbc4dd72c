"""Kernels: binding by name, dispatch, constants, groups, drawing; the same input gives the same bits."""

from __future__ import annotations

import gc

import numpy as np
import pytest

from runtime.encoder import Recorder
from runtime.kernel import MAX_WORKGROUPS, Kernel, RasterKernel, vertex_layouts
from runtime.resources import Buffer, Sampler, Texture
from runtime.wgsl import WgslError

SCALE = """
override FACTOR: f32 = 2.0;
override SIZE: u32 = 64;
@group(0) @binding(0) var<storage, read_write> values: array<f32>;
@group(0) @binding(3) var<uniform> offset: vec4f;

@compute @workgroup_size(SIZE)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if id.x < arrayLength(&values) {
        values[id.x] = FACTOR * values[id.x] + offset.x;
    }
}
"""


def run(gpu, kernel, groups, *shared, **bindings):
    recorder = Recorder(gpu)
    with recorder.compute(kernel.name) as compute_pass:
        kernel.dispatch(compute_pass, groups, *shared, **bindings)
    recorder.submit()


@pytest.fixture
def offset(gpu):
    return Buffer(gpu, np.array([3, 0, 0, 0], np.float32), "uniform", label="offset")


def test_a_dispatch_computes(gpu, shaders, offset):
    kernel = Kernel(gpu, "scale", root=shaders({"scale": SCALE}))
    values = Buffer(gpu, np.arange(1000, dtype=np.float32))
    run(gpu, kernel, kernel.groups_for(1000), values=values, offset=offset)
    np.testing.assert_array_equal(values.read(), 2 * np.arange(1000) + 3)


def test_constants_set_overrides(gpu, shaders, offset):
    root = shaders({"scale": SCALE})
    kernel = Kernel(gpu, "scale", constants={"FACTOR": -1.5, "SIZE": 32}, root=root)
    assert kernel.workgroup_size == (32, 1, 1)
    assert kernel.groups_for(100) == (4, 1, 1)
    values = Buffer(gpu, np.arange(100, dtype=np.float32))
    run(gpu, kernel, kernel.groups_for(100), values=values, offset=offset)
    np.testing.assert_array_equal(values.read(), -1.5 * np.arange(100) + 3)
    with pytest.raises(ValueError, match="scale has no override FACTR; it has FACTOR, SIZE"):
        Kernel(gpu, "scale", constants={"FACTR": 1}, root=root)


def test_an_override_without_default_needs_a_value(gpu, shaders):
    root = shaders({"k": "override N: u32;\n@compute @workgroup_size(N)\nfn main() {}\n"})
    with pytest.raises(ValueError, match="k needs a value for the override N"):
        Kernel(gpu, "k", root=root)
    assert Kernel(gpu, "k", constants={"N": 16}, root=root).workgroup_size == (16, 1, 1)


def test_names_are_checked(gpu, shaders, offset):
    kernel = Kernel(gpu, "scale", root=shaders({"scale": SCALE}))
    values = Buffer(gpu, 64)
    with pytest.raises(TypeError, match="scale needs offset; it binds values, offset"):
        run(gpu, kernel, 1, values=values)
    with pytest.raises(TypeError, match="scale binds no probes; it binds values, offset"):
        run(gpu, kernel, 1, values=values, offset=offset, probes=values)


def test_shared_bindings_may_hold_more_than_a_kernel_needs(gpu, shaders, offset):
    kernel = Kernel(gpu, "scale", root=shaders({"scale": SCALE}))
    values = Buffer(gpu, np.ones(4, np.float32))
    world = {"offset": offset, "primitives": Buffer(gpu, 64)}
    run(gpu, kernel, 1, world, values=values)
    assert values.read().tolist() == [5, 5, 5, 5]


def test_workgroups_beyond_the_limit_are_refused(gpu, shaders, offset):
    kernel = Kernel(gpu, "scale", root=shaders({"scale": SCALE}))
    with pytest.raises(ValueError, match="65536 x 1 x 1 workgroups; WebGPU allows 65535 on an axis"):
        run(gpu, kernel, (MAX_WORKGROUPS + 1, 1, 1), values=Buffer(gpu, 4), offset=offset)


def test_groups_cover_the_invocations(gpu, shaders):
    text = "@compute @workgroup_size(8, 4, 2)\nfn main() {}\n"
    kernel = Kernel(gpu, "k", root=shaders({"k": text}))
    assert kernel.groups_for(17, 4, 3) == (3, 1, 2)
    assert kernel.groups_for(0) == (0, 1, 1)


BIND_ALL = """
@group(0) @binding(0) var<storage, read> table: array<f32>;
@group(0) @binding(1) var<uniform> frame: vec4f;
@group(0) @binding(2) var albedo: texture_2d<f32>;
@group(0) @binding(3) var linear: sampler;
@group(0) @binding(4) var picture: texture_storage_2d<rgba16float, write>;
@group(0) @binding(5) var ids: texture_2d<u32>;

@compute @workgroup_size(1)
fn main() {
    let color = textureSampleLevel(albedo, linear, vec2f(0.5), 0.0) + frame + table[0];
    textureStore(picture, vec2u(0), color + f32(textureLoad(ids, vec2u(0), 0).x));
}
"""


@pytest.fixture
def fitting(gpu):
    """Resources that BIND_ALL accepts."""
    return {
        "table": Buffer(gpu, 16, label="table"),
        "frame": Buffer(gpu, 16, "uniform", label="frame"),
        "albedo": Texture(gpu, (2, 2), "rgba8unorm", label="albedo"),
        "linear": Sampler(gpu),
        "picture": Texture(gpu, (2, 2), "rgba16float", label="picture"),
        "ids": Texture(gpu, (2, 2), "r32uint", label="ids"),
    }


@pytest.mark.parametrize(
    ("name", "make", "message"),
    [
        ("table", lambda gpu: Texture(gpu, (2, 2), "r32uint"), r"table is a array<f32>, not a Texture"),
        ("table", lambda gpu: Buffer(gpu, 16, "uniform"), r"table .* lacks usage 'storage'"),
        ("frame", lambda gpu: Buffer(gpu, 16), r"frame .* lacks usage 'uniform'"),
        ("albedo", lambda gpu: Buffer(gpu, 16), r"albedo is a texture_2d<f32>, not a Buffer"),
        ("albedo", lambda gpu: Texture(gpu, (2, 2), "r32uint"), r"albedo .* not r32uint"),
        ("albedo", lambda gpu: Texture(gpu, (2, 2, 2), "rgba8unorm"), r"albedo .* not 3d"),
        (
            "albedo",
            lambda gpu: Texture(gpu, (2, 2), "rgba8unorm", "render"),
            r"albedo .* lacks usage 'sample'",
        ),
        ("albedo", lambda gpu: np.zeros(4), r"albedo is a texture_2d<f32>, not a ndarray"),
        ("linear", lambda gpu: Texture(gpu, (2, 2), "rgba8unorm"), r"linear is a sampler, not a Texture"),
        ("linear", lambda gpu: Sampler(gpu, compare="less"), r"linear is a sampler, .*compare"),
        ("picture", lambda gpu: Texture(gpu, (2, 2), "rgba32float"), r"picture .* not rgba32float"),
        (
            "picture",
            lambda gpu: Texture(gpu, (2, 2), "rgba16float", "sample"),
            r"picture .* lacks usage 'storage'",
        ),
        ("ids", lambda gpu: Texture(gpu, (2, 2), "rgba8unorm"), r"ids is a texture_2d<u32>, not rgba8unorm"),
    ],
)
def test_resources_are_checked_against_their_declaration(gpu, shaders, fitting, name, make, message):
    kernel = Kernel(gpu, "bind_all", root=shaders({"bind_all": BIND_ALL}))
    run(gpu, kernel, 1, **fitting)
    with pytest.raises(TypeError, match="bind_all: " + message):
        run(gpu, kernel, 1, **{**fitting, name: make(gpu)})


def test_a_texture_that_cannot_be_filtered_is_refused_where_it_is_sampled(gpu, shaders, fitting, monkeypatch):
    kernel = Kernel(gpu, "bind_all", root=shaders({"bind_all": BIND_ALL}))
    monkeypatch.setattr(gpu, "features", frozenset())
    with pytest.raises(TypeError, match=r"albedo .* cannot filter rgba32float .* use textureLoad"):
        run(gpu, kernel, 1, **{**fitting, "albedo": Texture(gpu, (2, 2), "rgba32float")})


@pytest.mark.parametrize("format", ["rgba8unorm", "r32float", "rgba32float", "rgba16float", "depth32float"])
def test_a_texture_that_is_only_loaded_may_have_any_float_format(gpu, shaders, format):
    text = """
@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var<storage, read_write> out: array<f32>;
@compute @workgroup_size(1)
fn main() { out[0] = textureLoad(picture, vec2u(0), 0).x; }
"""
    kernel = Kernel(gpu, "load", root=shaders({"load": text}))
    picture, out = Texture(gpu, (1, 1), format), Buffer(gpu, np.zeros(1, np.float32))
    recorder = Recorder(gpu)
    if format == "depth32float":
        with recorder.render("clear", depth=picture, clear_depth=1.0):
            pass
    else:
        with recorder.render("clear", [picture], clear_color=(1, 0, 0, 0)):
            pass
    with recorder.compute("load") as compute_pass:
        kernel.dispatch(compute_pass, 1, picture=picture, out=out)
    recorder.submit()
    assert out.read().tolist() == [1]


def test_groups_between_may_be_empty(gpu, shaders):
    text = """
@group(0) @binding(0) var<storage, read_write> out: array<f32>;
@group(3) @binding(1) var<uniform> frame: vec4f;
@compute @workgroup_size(1)
fn main() { out[0] = frame.y; }
"""
    kernel = Kernel(gpu, "gap", root=shaders({"gap": text}))
    out = Buffer(gpu, np.zeros(1, np.float32))
    run(gpu, kernel, 1, out=out, frame=Buffer(gpu, np.array([1, 2, 3, 4], np.float32), "uniform"))
    assert out.read().tolist() == [2]


def test_a_kernel_without_resources_runs(gpu, shaders):
    kernel = Kernel(gpu, "k", root=shaders({"k": "@compute @workgroup_size(1)\nfn main() {}\n"}))
    run(gpu, kernel, (2, 2))


def test_bind_groups_are_made_once_and_dropped_with_their_resources(gpu, shaders, offset):
    root = shaders({"scale": SCALE})
    first, second = Kernel(gpu, "scale", root=root), Kernel(gpu, "scale", constants={"FACTOR": 3}, root=root)
    values = Buffer(gpu, np.ones(4, np.float32))
    gc.collect()
    before = len(gpu.bind_groups)
    for kernel in (first, second, first):
        run(gpu, kernel, 1, values=values, offset=offset)
    assert len(gpu.bind_groups) == before + 1
    other = Buffer(gpu, np.ones(4, np.float32))
    run(gpu, first, 1, values=other, offset=offset)
    assert len(gpu.bind_groups) == before + 2
    assert other.read().tolist() == [5] * 4
    del values, other
    gc.collect()
    assert len(gpu.bind_groups) == before


def test_counts_may_come_from_a_buffer(gpu, shaders, offset):
    kernel = Kernel(gpu, "scale", constants={"SIZE": 4}, root=shaders({"scale": SCALE}))
    counts = Buffer(gpu, np.array([9, 9, 9, 2, 1, 1], np.uint32), "storage|indirect")
    values = Buffer(gpu, np.zeros(16, np.float32))
    recorder = Recorder(gpu)
    with recorder.compute("scale") as compute_pass:
        kernel.dispatch_indirect(compute_pass, counts, 12, values=values, offset=offset)
    recorder.submit()
    assert values.read().tolist() == [3] * 8 + [0] * 8


SUM = """
@group(0) @binding(0) var<storage, read> values: array<f32>;
@group(0) @binding(1) var<storage, read_write> sums: array<f32>;
var<workgroup> partial: array<f32, 64>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) lane: u32,
        @builtin(workgroup_id) group: vec3u) {
    partial[lane] = sin(values[id.x]);
    workgroupBarrier();
    for (var step = 32u; step > 0u; step >>= 1u) {
        if lane < step { partial[lane] += partial[lane + step]; }
        workgroupBarrier();
    }
    if lane == 0u { sums[group.x] = partial[0]; }
}
"""


def test_the_same_input_gives_the_same_bits(gpu, shaders):
    values = np.random.default_rng(5).normal(size=64 * 50).astype(np.float32) * 100
    root = shaders({"sum": SUM})
    results = []
    for _ in range(3):
        kernel, sums = Kernel(gpu, "sum", root=root), Buffer(gpu, np.zeros(50, np.float32))
        run(gpu, kernel, 50, values=Buffer(gpu, values), sums=sums)
        results.append(sums.read())
    np.testing.assert_allclose(results[0], np.sin(values).reshape(50, 64).sum(axis=1), atol=1e-2)
    assert results[0].tobytes() == results[1].tobytes() == results[2].tobytes()


DRAW = """
struct Varyings { @builtin(position) clip: vec4f, @location(0) color: vec4f }
@group(0) @binding(0) var<storage, read> tints: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> count: array<atomic<u32>>;

@vertex
fn vertex_main(@location(0) position: vec3f, @location(1) tint: u32) -> Varyings {
    return Varyings(vec4f(position, 1.0), tints[tint]);
}

@fragment
fn fragment_main(varyings: Varyings) -> @location(0) vec4f {
    atomicAdd(&count[0], 1u);
    return varyings.color;
}
"""
VERTEX = np.dtype([("position", "<f4", 3), ("tint", "<u4")])


def triangle(depth: float, tint: int) -> np.ndarray:
    """Covers the picture's left half, counter-clockwise."""
    vertices = np.zeros(3, VERTEX)
    vertices["position"] = [(-6, 0, depth), (0, -3, depth), (0, 3, depth)]
    vertices["tint"] = tint
    return vertices


@pytest.mark.parametrize("cull", ["none", "back", "front"])
def test_a_raster_kernel_draws_with_depth(gpu, shaders, cull):
    kernel = RasterKernel(
        gpu, "draw", ["rgba32float"], vertex_buffers=[VERTEX], cull=cull, root=shaders({"draw": DRAW})
    )
    color, depth = Texture(gpu, (8, 8), "rgba32float"), Texture(gpu, (8, 8), "depth32float")
    near_then_far = Buffer(gpu, np.concatenate([triangle(0.25, 1), triangle(0.75, 0)]), "vertex")
    tints = Buffer(gpu, np.array([[1, 0, 0, 1], [0, 1, 0, 1]], np.float32))
    count = Buffer(gpu, np.zeros(1, np.uint32))
    recorder = Recorder(gpu)
    with recorder.render("draw", [color], depth, clear_color=(0, 0, 1, 1)) as render_pass:
        kernel.bind(render_pass, tints=tints, count=count)
        render_pass.set_vertex_buffer(0, near_then_far.wgpu_buffer)
        render_pass.draw(6)
    recorder.submit()
    left = [0, 0, 1, 1] if cull == "front" else [0, 1, 0, 1]
    picture = color.read()
    assert picture[:, :4].reshape(-1, 4).tolist() == [left] * 32
    assert picture[:, 4:].reshape(-1, 4).tolist() == [[0, 0, 1, 1]] * 32
    assert depth.read()[:, :4].ravel().tolist() == [1.0 if cull == "front" else 0.25] * 32
    assert count.read()[0] == (0 if cull == "front" else 64)


def test_depth_alone_is_drawn_without_colours(gpu, shaders):
    text = "@vertex\nfn vertex_main(@location(0) position: vec3f) -> @builtin(position) vec4f {\n"
    text += "    return vec4f(position, 1.0);\n}\n"
    kernel = RasterKernel(
        gpu,
        "shadow",
        vertex_buffers=[np.dtype([("p", "<f4", 3)])],
        depth_compare="greater",
        root=shaders({"shadow": text}),
    )
    depth = Texture(gpu, (4, 4), "depth32float")
    positions = Buffer(gpu, triangle(0.5, 0)["position"].copy(), "vertex")
    recorder = Recorder(gpu)
    with recorder.render("shadow", depth=depth, clear_depth=0.0) as render_pass:
        kernel.bind(render_pass)
        render_pass.set_vertex_buffer(0, positions.wgpu_buffer)
        render_pass.draw(3)
    recorder.submit()
    assert depth.read().tolist() == [[0.5, 0.5, 0.0, 0.0]] * 4


def test_kernels_need_their_entry_points(gpu, shaders):
    root = shaders({"lib": "fn f() {}\n", "draw": DRAW})
    with pytest.raises(WgslError, match=r"lib\.wgsl:1: lib has no @compute entry point"):
        Kernel(gpu, "lib", root=root)
    with pytest.raises(WgslError, match=r"lib\.wgsl:1: lib needs a @vertex"):
        RasterKernel(gpu, "lib", ["rgba8unorm"], root=root)


def test_vertex_layouts_follow_the_dtypes():
    packed = np.dtype([("position", "<f4", 3), ("uv", "<f2", 2), ("joints", "u1", 4), ("id", "<u4")])
    first, second = vertex_layouts([packed, {"array_stride": 16, "attributes": [], "step_mode": "instance"}])
    assert first["array_stride"] == 24
    assert [(a["format"], a["offset"], a["shader_location"]) for a in first["attributes"]] == [
        ("float32x3", 0, 0),
        ("float16x2", 12, 1),
        ("uint8x4", 16, 2),
        ("uint32", 20, 3),
    ]
    assert second["step_mode"] == "instance"
