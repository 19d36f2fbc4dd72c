"""Structs shared by Python and WGSL: offsets by WGSL's rules, and the GPU reads what Python packed."""

from __future__ import annotations

import subprocess
import sys
from typing import Annotated

import numpy as np
import pytest

from runtime import layouts
from runtime.encoder import Recorder
from runtime.kernel import Kernel
from runtime.resources import Buffer
from runtime.structs import (
    STRUCTS_FILE,
    GpuStruct,
    atomic_u32,
    f32,
    generate,
    i32,
    mat3x3f,
    mat4x4f,
    u32,
    vec2f,
    vec3f,
    vec3u,
    vec4f,
    vec4i,
    write,
)


class Ray(GpuStruct):
    origin: vec3f
    tag: u32
    direction: vec3f


class Everything(GpuStruct):
    scale: f32
    point: vec3f
    offset: i32
    extent: vec2f
    clip_from_local: mat4x4f
    flag: u32
    rotation: mat3x3f
    rays: Annotated[Ray, 2]
    planes: Annotated[vec4f, 3]
    corners: Annotated[vec3f, 2]
    cell: vec3u


class Counters(GpuStruct):
    used: atomic_u32
    overflowed: atomic_u32
    bins: Annotated[u32, 5]


@pytest.fixture
def everything() -> np.ndarray:
    rng = np.random.default_rng(3)
    return Everything.pack(
        scale=0.5,
        point=rng.random(3),
        offset=-7,
        extent=rng.random(2),
        clip_from_local=rng.random((4, 4)),
        flag=9,
        rotation=rng.random((3, 3)),
        rays=Ray.pack_array(2, origin=rng.random((2, 3)), tag=[4, 5], direction=rng.random((2, 3))),
        planes=rng.random((3, 4)),
        corners=rng.random((2, 3)),
        cell=[1, 2, 3],
    )


def test_offsets_follow_the_rules_of_wgsl():
    offsets = {field.name: field.offset for field in Everything.layout.fields}
    assert offsets == {
        "scale": 0,
        "point": 16,
        "offset": 28,
        "extent": 32,
        "clip_from_local": 48,
        "flag": 112,
        "rotation": 128,
        "rays": 176,
        "planes": 240,
        "corners": 288,
        "cell": 320,
    }
    assert Everything.dtype.itemsize == Everything.layout.size == 336
    assert Ray.dtype.itemsize == 32
    assert Counters.dtype.itemsize == 28


def test_matrices_are_given_row_by_row_and_stored_by_columns():
    class Matrices(GpuStruct):
        projection: mat4x4f
        rotation: mat3x3f

    projection, rotation = np.arange(16.0).reshape(4, 4), np.arange(9.0).reshape(3, 3)
    words = np.frombuffer(Matrices.pack(projection=projection, rotation=rotation).tobytes(), np.float32)
    assert words[:16].tolist() == projection.T.ravel().tolist()
    assert words[16:].reshape(3, 4)[:, :3].tolist() == rotation.T.tolist()


READ_ALL = """
import package::structs::{Everything};
@group(0) @binding(0) var<storage, read> all: Everything;
@group(0) @binding(1) var<storage, read_write> out: array<f32>;

@compute @workgroup_size(1)
fn main() {
    let transformed = all.clip_from_local * vec4f(1.0, 2.0, 3.0, 4.0);
    let turned = all.rotation * vec3f(1.0, 2.0, 3.0);
    out[0] = all.scale + f32(all.offset) + f32(all.flag) + all.extent.y;
    for (var i = 0u; i < 3u; i++) {
        out[1 + i] = all.point[i];
        out[4 + i] = transformed[i];
        out[7 + i] = turned[i];
        out[10 + i] = all.rays[1].origin[i] + all.rays[0].direction[i];
        out[13 + i] = all.planes[2][i + 1];
        out[16 + i] = all.corners[1][i];
        out[19 + i] = f32(all.cell[i] + all.rays[1].tag);
    }
}
"""


def test_the_gpu_reads_what_python_packed(gpu, shaders, everything):
    root = shaders({"structs": generate([Ray, Everything]), "read_all": READ_ALL})
    kernel = Kernel(gpu, "read_all", root=root)
    out = Buffer(gpu, np.zeros(22, np.float32))
    recorder = Recorder(gpu)
    with recorder.compute("read_all") as compute_pass:
        kernel.dispatch(compute_pass, 1, all=Buffer(gpu, everything), out=out)
    recorder.submit()

    record = everything
    clip_from_local = record["clip_from_local"].T
    rotation = record["rotation"][:, :3].T
    expected = [
        [record["scale"] + record["offset"] + record["flag"] + record["extent"][1]],
        record["point"],
        (clip_from_local @ [1, 2, 3, 4])[:3],
        rotation @ [1, 2, 3],
        record["rays"]["origin"][1] + record["rays"]["direction"][0],
        record["planes"][2][1:],
        record["corners"]["value"][1],
        np.array([1, 2, 3]) + 5,
    ]
    np.testing.assert_allclose(out.read(), np.concatenate(expected), rtol=1e-5)


def test_records_are_packed_column_by_column():
    rays = Ray.pack_array(3, origin=[[1, 2, 3]], tag=[7, 8, 9], direction=np.eye(3))
    assert rays["origin"].tolist() == [[1, 2, 3]] * 3
    assert rays["tag"].tolist() == [7, 8, 9]
    assert Everything.dtype["rays"].base == Ray.dtype
    assert rays.nbytes == 3 * 32


def test_records_nest():
    class Pair(GpuStruct):
        first: Ray
        second: Ray

    ray = Ray.pack(origin=[1, 2, 3], tag=4, direction=[0, 0, 1])
    pair = Pair.pack(first=ray, second={"origin": [5, 6, 7], "tag": 8, "direction": [1, 0, 0]})
    assert pair["first"] == ray
    assert pair["second"]["origin"].tolist() == [5, 6, 7]
    with pytest.raises(TypeError, match=r"Pair\.first takes records of Ray"):
        Pair.pack(first=np.zeros(8), second=ray)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"origin": [0, 0, 0], "tag": 1}, "missing direction"),
        ({"origin": [0, 0, 0], "tag": 1, "direction": [0, 0, 0], "length": 1}, "unknown length"),
        ({"origin": [0, 0], "tag": 1, "direction": [0, 0, 0]}, r"Ray\.origin takes shape \(3,\), not \(2,\)"),
        ({"origin": 1.0, "tag": 1, "direction": [0, 0, 0]}, r"Ray\.origin takes shape \(3,\), not \(\)"),
        ({"origin": [0, 0, 0], "tag": 1.5, "direction": [0, 0, 0]}, r"Ray\.tag holds integers"),
    ],
)
def test_packing_names_what_is_amiss(values, message):
    with pytest.raises(TypeError, match=message):
        Ray.pack(**values)


def test_a_column_of_the_wrong_length_is_refused():
    with pytest.raises(TypeError, match=r"Ray\.tag"):
        Ray.pack_array(3, origin=np.zeros((3, 3)), tag=[1, 2], direction=np.zeros((3, 3)))


def test_declarations_are_checked():
    with pytest.raises(TypeError, match=r"Bad\.length: .* is no GPU type"):
        type("Bad", (GpuStruct,), {"__annotations__": {"length": float}, "__module__": __name__})
    with pytest.raises(TypeError, match=r"Bad\.pack: .* choose another"):
        type("Bad", (GpuStruct,), {"__annotations__": {"pack": f32}, "__module__": __name__})
    with pytest.raises(TypeError, match=r"Bad\.planes: an array needs a positive count, not 0"):
        type(
            "Bad", (GpuStruct,), {"__annotations__": {"planes": Annotated[vec4f, 0]}, "__module__": __name__}
        )
    with pytest.raises(TypeError, match="Bad has no members"):
        type("Bad", (GpuStruct,), {"__annotations__": {}, "__module__": __name__})


def test_the_text_shows_offsets():
    assert Ray.wgsl() == (
        "struct Ray {  // 32 bytes\n"
        "    origin: vec3f,     // 0\n"
        "    tag: u32,          // 12\n"
        "    direction: vec3f,  // 16\n"
        "}"
    )
    assert "bins: array<u32, 5>," in Counters.wgsl()
    assert "used: atomic<u32>," in Counters.wgsl()


def test_structs_are_generated_in_order():
    class Bounds(GpuStruct):
        low: vec4i

    with pytest.raises(TypeError, match=r"Everything\.rays: list Ray before it"):
        generate([Everything])
    with pytest.raises(TypeError, match="two structs are named Bounds"):
        generate([Bounds, Bounds])


def test_the_committed_text_is_current():
    assert STRUCTS_FILE.read_text(encoding="utf-8") == generate(layouts.STRUCTS), (
        "run `python -m runtime.structs` and commit runtime/shaders/structs.wgsl"
    )


def test_structs_are_written_in_one_step(tmp_path):
    path = tmp_path / "structs.wgsl"
    write([Ray], path)
    assert path.read_text(encoding="utf-8") == generate([Ray])
    assert [entry.name for entry in tmp_path.iterdir()] == ["structs.wgsl"]


def test_the_module_regenerates_the_file(repository):
    before = STRUCTS_FILE.read_bytes()
    subprocess.run([sys.executable, "-m", "runtime.structs"], cwd=repository, check=True)
    assert STRUCTS_FILE.read_bytes() == before
