"""Buffers and textures give back what was put into them."""

from __future__ import annotations

import numpy as np
import pytest

from runtime.encoder import Recorder
from runtime.formats import FORMATS, lookup
from runtime.kernel import Kernel
from runtime.resources import Buffer, PingPong, Sampler, Texture


def random_texels(shape, texel, seed=0):
    rng = np.random.default_rng(seed)
    full = shape + ((texel.channels,) if texel.channels > 1 else ())
    if texel.dtype.kind == "f":
        return rng.random(full).astype(texel.dtype)
    return rng.integers(
        np.iinfo(texel.dtype).min, np.iinfo(texel.dtype).max, full, texel.dtype, endpoint=True
    )


def test_buffers_keep_arrays(gpu):
    values = np.random.default_rng(1).random((5, 3)).astype(np.float32)
    buffer = Buffer(gpu, values, label="values")
    assert buffer.size == 60
    np.testing.assert_array_equal(buffer.read(), values)
    buffer.write(np.float32([7, 8]), offset=12)
    assert buffer.read()[1].tolist() == [7, 8, values[1, 2]]
    assert buffer.read(np.float32, 2, offset=12).tolist() == [7, 8]
    assert buffer.read(np.uint32, (5, 3)).dtype == np.uint32


def test_buffer_sizes_are_rounded_up(gpu):
    assert Buffer(gpu, b"abcde").size == 8
    assert Buffer(gpu, b"abcde").read().tobytes() == b"abcde\0\0\0"
    assert Buffer(gpu, 20, "uniform").size == 32
    assert Buffer(gpu, 64).read().tolist() == [0] * 64
    assert Buffer(gpu, np.array([1, 2, 3], np.uint8)).read().tolist() == [1, 2, 3]


def test_strided_arrays_and_records_are_written_whole(gpu):
    grid = np.arange(12, dtype=np.int32).reshape(3, 4)
    np.testing.assert_array_equal(Buffer(gpu, grid.T).read(), grid.T)
    records = np.zeros(3, np.dtype({"names": ["a"], "formats": ["<f4"], "offsets": [4], "itemsize": 16}))
    records["a"] = [1, 2, 3]
    assert Buffer(gpu, records).read()["a"].tolist() == [1, 2, 3]
    assert Buffer(gpu, records[0]).size == 16


def test_buffer_faults(gpu):
    buffer = Buffer(gpu, 16, label="table")
    with pytest.raises(ValueError, match="'table': 8 bytes at 12 do not fit into 16"):
        buffer.write(np.zeros(2, np.float32), offset=12)
    with pytest.raises(ValueError, match="'table': 5 x 4 bytes at 0 exceed 16"):
        buffer.read(np.float32, 5)
    with pytest.raises(ValueError, match="'none': 0 bytes; an empty buffer cannot be bound"):
        Buffer(gpu, np.zeros(0, np.float32), label="none")
    with pytest.raises(ValueError, match="no usage 'stroage'; there are storage, uniform"):
        Buffer(gpu, 16, "stroage")


@pytest.mark.parametrize("size", [(5, 3), (64, 2), (1, 1)])
@pytest.mark.parametrize("format", [name for name in FORMATS if name != "depth32float"])
def test_textures_keep_arrays(gpu, format, size):
    texture = Texture(gpu, size, format, label=format)
    data = random_texels((size[1], size[0]), texture.texel)
    texture.write(data)
    result = texture.read()
    assert result.dtype == texture.texel.dtype
    np.testing.assert_array_equal(result, data)


@pytest.mark.parametrize("dimension", ["3d", "2d-array"])
def test_volumes_and_arrays_keep_their_layers(gpu, dimension):
    texture = Texture(gpu, (5, 4, 3), "rgba16float", dimension=dimension)
    data = random_texels((3, 4, 5), texture.texel)
    texture.write(data)
    np.testing.assert_array_equal(texture.read(), data)


def test_mips_are_written_and_read_by_level(gpu):
    texture = Texture(gpu, (8, 4), "rgba8unorm", mips=3)
    levels = [random_texels((4 >> mip, 8 >> mip), texture.texel, mip) for mip in range(3)]
    for mip, level in enumerate(levels):
        texture.write(level, mip)
    for mip, level in enumerate(levels):
        np.testing.assert_array_equal(texture.read(mip), level)
    assert texture.mip_size(2) == (2, 1, 1)
    assert Texture(gpu, (8, 8, 8), "r32float", mips=2).mip_size(1) == (4, 4, 4)


def test_a_layer_is_a_texture_of_its_own(gpu):
    stack = Texture(gpu, (2, 2, 3), "rgba32float", dimension="2d-array")
    recorder = Recorder(gpu)
    for layer in range(3):
        with recorder.render("clear", [stack.view(layer=layer)], clear_color=(layer, 0, 0, 1)):
            pass
    recorder.submit()
    assert stack.read()[:, 0, 0, 0].tolist() == [0, 1, 2]
    assert stack.view(layer=1) is stack.view(layer=1)
    assert stack.view(layer=1).dimension == "2d"


def test_a_mip_binds_as_a_storage_texture(gpu, shaders):
    text = """
@group(0) @binding(0) var picture: texture_storage_2d<r32uint, write>;
@compute @workgroup_size(1)
fn main(@builtin(global_invocation_id) id: vec3u) { textureStore(picture, id.xy, vec4u(7)); }
"""
    kernel = Kernel(gpu, "fill", root=shaders({"fill": text}))
    texture = Texture(gpu, (4, 4), "r32uint", mips=2)
    recorder = Recorder(gpu)
    with recorder.compute("fill") as compute_pass:
        kernel.dispatch(compute_pass, (2, 2), picture=texture.view(mip=1))
    recorder.submit()
    assert texture.read(0).tolist() == [[0] * 4] * 4
    assert texture.read(1).tolist() == [[7] * 2] * 2


def test_texture_faults(gpu):
    texture = Texture(gpu, (4, 2), "rgba16float", label="probes")
    with pytest.raises(ValueError, match=r"'probes': mip 0 takes shape \(2, 4, 4\), not \(4, 2, 4\)"):
        texture.write(np.zeros((4, 2, 4), np.float16))
    with pytest.raises(ValueError, match="'probes': rgba16float takes float16, not uint8"):
        texture.write(np.zeros((2, 4, 4), np.uint8))
    with pytest.raises(ValueError, match="no texture format 'rgba16'; there are r8unorm"):
        Texture(gpu, (4, 2), "rgba16")
    with pytest.raises(ValueError, match="no 2d texture has size"):
        Texture(gpu, (4, 0), "rgba8unorm")
    with pytest.raises(ValueError, match="lets nobody write depth32float"):
        Texture(gpu, (2, 2), "depth32float").write(np.zeros((2, 2), np.float32))


def test_the_table_of_formats_is_true(gpu):
    """wgpu accepts every use that the table claims for a format."""
    for name, texel in FORMATS.items():
        texture = Texture(gpu, (4, 4), name)
        assert texture.size == (4, 4, 1)
        assert lookup(name) is texel
        if not texel.renderable:
            continue
        recorder = Recorder(gpu)
        depth = name == "depth32float"
        with recorder.render(name, [] if depth else [texture], texture if depth else None):
            pass
        recorder.submit()


@pytest.mark.parametrize(
    ("filter", "address", "expected"),
    [
        ("linear", "clamp-to-edge", [0.5, 0.0, 1.0]),
        ("nearest", "clamp-to-edge", [1.0, 0.0, 1.0]),
        ("linear", ("repeat", "clamp-to-edge"), [0.5, 0.5, 0.0]),
    ],
)
def test_samplers_filter_and_address(gpu, shaders, filter, address, expected):
    text = """
@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var smp: sampler;
@group(0) @binding(2) var<storage, read_write> out: array<f32>;
@compute @workgroup_size(1)
fn main() {
    out[0] = textureSampleLevel(picture, smp, vec2f(0.5001, 0.5), 0.0).x;
    out[1] = textureSampleLevel(picture, smp, vec2f(0.0001, 0.5), 0.0).x;
    out[2] = textureSampleLevel(picture, smp, vec2f(1.2500, 0.5), 0.0).x;
}
"""
    kernel = Kernel(gpu, "sample", root=shaders({"sample": text}))
    picture = Texture(gpu, (2, 1), "r16float", data=np.array([[0, 1]], np.float16))
    out = Buffer(gpu, np.zeros(3, np.float32))
    recorder = Recorder(gpu)
    with recorder.compute("sample") as compute_pass:
        kernel.dispatch(compute_pass, 1, picture=picture, smp=Sampler(gpu, filter, address), out=out)
    recorder.submit()
    np.testing.assert_allclose(out.read(), expected, atol=0.01)


@pytest.mark.parametrize(("mip_filter", "expected"), [("linear", 0.25), ("nearest", 0.0), (None, 0.25)])
def test_samplers_filter_between_mips(gpu, shaders, mip_filter, expected):
    text = """
@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var smp: sampler;
@group(0) @binding(2) var<storage, read_write> out: array<f32>;
@compute @workgroup_size(1)
fn main() { out[0] = textureSampleLevel(picture, smp, vec2f(0.5), 0.25).x; }
"""
    kernel = Kernel(gpu, "sample", root=shaders({"sample": text}))
    picture, out = Texture(gpu, (2, 2), "r16float", mips=2), Buffer(gpu, np.zeros(1, np.float32))
    picture.write(np.zeros((2, 2), np.float16))
    picture.write(np.ones((1, 1), np.float16), mip=1)
    recorder = Recorder(gpu)
    with recorder.compute("sample") as compute_pass:
        kernel.dispatch(compute_pass, 1, picture=picture, smp=Sampler(gpu, mip_filter=mip_filter), out=out)
    recorder.submit()
    np.testing.assert_allclose(out.read(), [expected], atol=0.01)


def test_a_comparison_sampler_compares(gpu, shaders):
    text = """
@group(0) @binding(0) var shadow: texture_depth_2d;
@group(0) @binding(1) var compare: sampler_comparison;
@group(0) @binding(2) var<storage, read_write> out: array<f32>;
@compute @workgroup_size(1)
fn main() {
    out[0] = textureSampleCompareLevel(shadow, compare, vec2f(0.5), 0.4);
    out[1] = textureSampleCompareLevel(shadow, compare, vec2f(0.5), 0.6);
}
"""
    kernel = Kernel(gpu, "compare", root=shaders({"compare": text}))
    shadow, out = Texture(gpu, (2, 2), "depth32float"), Buffer(gpu, np.zeros(2, np.float32))
    recorder = Recorder(gpu)
    with recorder.render("clear", depth=shadow, clear_depth=0.5):
        pass
    with recorder.compute("compare") as compute_pass:
        kernel.dispatch(compute_pass, 1, shadow=shadow, compare=Sampler(gpu, compare="less"), out=out)
    recorder.submit()
    assert out.read().tolist() == [1, 0]


def test_recorders_copy_and_clear(gpu):
    source, destination = Buffer(gpu, np.arange(8, dtype=np.uint32)), Buffer(gpu, np.zeros(8, np.uint32))
    data = np.arange(6, dtype=np.uint32).reshape(2, 3)
    picture, copy = Texture(gpu, (3, 2), "r32uint", data=data), Texture(gpu, (3, 2), "r32uint")
    recorder = Recorder(gpu)
    recorder.copy_buffer(source, destination, 16)
    recorder.clear(source)
    recorder.copy_texture(picture, copy)
    recorder.submit()
    assert destination.read().tolist() == [0, 1, 2, 3, 0, 0, 0, 0]
    assert source.read().tolist() == [0] * 8
    np.testing.assert_array_equal(copy.read(), data)


def test_render_targets_keep_what_is_not_cleared(gpu):
    first, second = Texture(gpu, (2, 2), "rgba32float"), Texture(gpu, (2, 2), "rgba32float")
    depth = Texture(gpu, (2, 2), "depth32float")
    recorder = Recorder(gpu)
    with recorder.render(
        "a", [first, second], depth, clear_color=[(1, 0, 0, 0), (2, 0, 0, 0)], clear_depth=0.5
    ):
        pass
    with recorder.render("b", [first, second], depth, clear_color=None, clear_depth=None):
        pass
    recorder.submit()
    assert first.read()[0, 0, 0] == 1
    assert second.read()[0, 0, 0] == 2
    assert depth.read()[0, 0] == 0.5


def test_a_pair_changes_roles():
    pair = PingPong("a", "b")
    assert (pair.current, pair.previous) == ("a", "b")
    pair.swap()
    assert (pair.current, pair.previous) == ("b", "a")
