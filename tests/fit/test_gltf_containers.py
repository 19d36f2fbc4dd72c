"""Containers and the files they point at: .gltf, .glb, data URIs, odd names, and what must not be opened."""

from __future__ import annotations

import base64
import json
import os
import struct

import numpy as np
import pytest

from fit.gltf import GltfError, load

UNIT = ([0, 0, 0], [1, 1, 0])


def with_buffer_uri(builder, path, uri):
    """Write a square whose buffer lies at `uri`; the buffer itself is the caller's to place."""
    builder.square()
    builder.document["buffers"] = [{"byteLength": len(builder.buffer), "uri": uri}]
    return builder.write(path)


@pytest.mark.parametrize("name", ["plain.gltf", "plain.glb", "Ünï ❤ cødé.gltf"])
def test_containers(builder, tmp_path, name):
    builder.square()
    scene = load(builder.write(tmp_path / name))
    assert np.array_equal(scene.bounds(), UNIT)
    assert scene.source == tmp_path / name


def test_path_as_text_and_relative(builder, tmp_path, monkeypatch):
    builder.square()
    builder.write(tmp_path / "a.gltf")
    monkeypatch.chdir(tmp_path)
    assert load("a.gltf").triangle_count == 2


def base64_uri(data, kind="application/octet-stream"):
    return f"data:{kind};base64," + base64.b64encode(data).decode()


def percent_uri(data):
    return "data:application/octet-stream," + "".join(f"%{byte:02x}" for byte in data)


@pytest.mark.parametrize(
    "encode",
    [
        base64_uri,
        percent_uri,
        lambda data: base64_uri(data).replace("base64", "BASE64").rstrip("="),
        lambda data: base64_uri(data)[:60] + "\n " + base64_uri(data)[60:],
        lambda data: base64_uri(data, ""),
    ],
    ids=["base64", "percent", "without padding", "with white space", "without a type"],
)
def test_data_uris(builder, tmp_path, encode):
    builder.square()
    file = builder.write(tmp_path / "embedded.gltf")
    document = json.loads(file.read_text())
    document["buffers"][0]["uri"] = encode(bytes(builder.buffer))
    (tmp_path / "embedded.bin").unlink()
    file.write_text(json.dumps(document))
    assert np.array_equal(load(file).bounds(), UNIT)


@pytest.mark.parametrize(
    ("uri", "real_name"),
    [
        ("my%20data.bin", "my data.bin"),
        ("my%20data.bin", "my%20data.bin"),
        ("my data.bin", "my data.bin"),
        ("sub/deep/./data.bin", "sub/deep/data.bin"),
        ("sub/../data.bin", "data.bin"),
        ("sub\\data.bin", "sub/data.bin"),
        ("%E2%9D%A4.bin", "❤.bin"),
        ("50%.bin", "50%.bin"),
    ],
)
def test_file_names(builder, tmp_path, uri, real_name):
    file = with_buffer_uri(builder, tmp_path / "named.gltf", uri)
    (tmp_path / "sub" / "deep").mkdir(parents=True)
    (tmp_path / real_name).write_bytes(builder.buffer)
    assert np.array_equal(load(file).bounds(), UNIT)


@pytest.mark.parametrize(
    ("uri", "message"),
    [
        ("../secret.bin", "leaves the folder"),
        ("%2e%2e/secret.bin", "leaves the folder"),
        ("..%2Fsecret.bin", "leaves the folder"),
        ("..\\secret.bin", "leaves the folder"),
        ("sub/../../secret.bin", "leaves the folder"),
        ("link.bin", "leaves the folder"),
        ("folder_link/secret.bin", "leaves the folder"),
        ("/etc/passwd", "is not a relative path"),
        ("\\\\server\\share", "is not a relative path"),
        ("file:///etc/passwd", "is not a relative path"),
        ("http://example.com/a.bin", "is not a relative path"),
        ("C:/secret.bin", "is not a relative path"),
        ("nul\0byte.bin", "is not a usable file name"),
        ("x" * 5000, "is not a usable file name"),
        (".", "is missing"),
        ("", "is missing"),
        ("nothing.bin", "'nothing.bin' is missing; put it beside named.gltf"),
        ("data:application/octet-stream;base64", "is a data URI without a comma"),
        ("data:;base64,@@@@", "is a data URI whose base64 is damaged"),
        ("data:;base64,A", "is a data URI whose base64 is damaged"),
        ("data:;base64,❤", "is a data URI whose base64 is damaged"),
        ("\ud800.bin", "is missing"),
        (7, "must be a string, not 7"),
    ],
)
def test_foreign_and_damaged_uris(builder, tmp_path, uri, message):
    folder = tmp_path / "inside"
    (folder / "sub").mkdir(parents=True)
    file = with_buffer_uri(builder, folder / "named.gltf", uri)
    (tmp_path / "secret.bin").write_bytes(builder.buffer)
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    (folder / "folder_link").symlink_to(tmp_path)
    with pytest.raises(GltfError, match=r"buffers\[0\]\.uri: ") as caught:
        load(file)
    assert message in str(caught.value)


def test_links_within_the_folder_are_followed(builder, tmp_path):
    file = with_buffer_uri(builder, tmp_path / "named.gltf", "link.bin")
    (tmp_path / "real.bin").write_bytes(builder.buffer)
    (tmp_path / "link.bin").symlink_to(tmp_path / "real.bin")
    assert load(file).triangle_count == 2


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_not_waited_for(builder, tmp_path):
    file = with_buffer_uri(builder, tmp_path / "named.gltf", "pipe.bin")
    os.mkfifo(tmp_path / "pipe.bin")
    with pytest.raises(GltfError, match=r"'pipe\.bin' is missing"):
        load(file)


def test_an_external_buffer_may_be_longer_but_not_shorter(builder, tmp_path):
    file = with_buffer_uri(builder, tmp_path / "named.gltf", "data.bin")
    (tmp_path / "data.bin").write_bytes(bytes(builder.buffer) + b"tail")
    assert load(file).triangle_count == 2
    (tmp_path / "data.bin").write_bytes(builder.buffer[:-1])
    with pytest.raises(GltfError, match=r"buffers\[0\]\.byteLength: declares 60 bytes but only 59 are there"):
        load(file)


def test_a_buffer_that_nothing_reads_may_be_missing(builder, tmp_path):
    builder.square()
    builder.document["buffers"] = [{"byteLength": 10, "uri": "gone.bin"}]
    assert load(builder.write(tmp_path / "two.glb")).triangle_count == 2


def chunks(*parts, version=2, length=None):
    body = b"".join(struct.pack("<I4s", len(data), kind) + data for kind, data in parts)
    return struct.pack("<4sII", b"glTF", version, 12 + len(body) if length is None else length) + body


JSON_CHUNK = (b"JSON", b'{"asset":{"version":"2.0"}} ')


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"glTF", "glb header: the file ends within it"),
        (chunks(JSON_CHUNK, version=1), "glTF version 1 is not supported, only 2.0 is"),
        (chunks(JSON_CHUNK, length=10_000), "glb header: declares 10000 bytes but the file has 48"),
        (chunks(JSON_CHUNK, length=4), "glb header: declares 4 bytes"),
        (chunks(JSON_CHUNK)[:-8].replace(struct.pack("<I", 48), struct.pack("<I", 40)), "runs past the end"),
        (chunks((b"BIN\0", b"1234")), "there is no JSON chunk"),
        (chunks((b"JSON", b"{]  ")), "JSON: can't be parsed"),
        (chunks((b"JSON", b"\xff\xfe{}")), "JSON: can't be parsed"),
        (b"", "is not a glTF 2.0 file"),
        (b"solid stl", "is not a glTF 2.0 file"),
        (b"[1]", "is not a glTF 2.0 file"),
        (b"{", "JSON: can't be parsed"),
        (b'{"asset": {"version": "2.0"}, "x": NaN}', "NaN is not a JSON number"),
        (b'{"x": ' + b"[" * 200_000 + b"]" * 200_000 + b"}", "JSON: is nested too deeply"),
        (b'{"x": ' + b"9" * 5000 + b"}", "JSON: can't be parsed"),
        (b"{}", "asset: required but missing"),
        (b'{"asset": {}}', "asset.version: required but missing"),
        (b'{"asset": {"version": 2.0}}', "asset.version: must be a string, not 2.0"),
        (b'{"asset": {"version": "1.0"}}', "convert a glTF 1.0 file with `npx gltf-pipeline"),
        (b'{"asset": {"version": "2.1", "minVersion": "2.1"}}', "needs a reader of glTF 2.1"),
        (b'{"asset": {"version": "2.0"}, "scene": 3, "scenes": [{}]}', "scene: index 3 points past the end"),
        (b'{"asset": {"version": "2.0"}, "nodes": {}}', "nodes: must be an array, not {}"),
        (b'{"asset": {"version": "2.0"}, "nodes": [4]}', "nodes[0]: must be an object, not 4"),
    ],
)
def test_damaged_containers(tmp_path, data, message):
    file = tmp_path / "damaged.gltf"
    file.write_bytes(data)
    with pytest.raises(GltfError) as caught:
        load(file)
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(file))


def test_unknown_chunks_and_trailing_bytes_are_skipped(builder, tmp_path):
    builder.square()
    data = builder.glb()
    extended = data + struct.pack("<I4s", 4, b"ACME") + b"1234"
    extended = extended[:8] + struct.pack("<I", len(extended)) + extended[12:] + b"tail"
    (tmp_path / "extended.glb").write_bytes(extended)
    assert load(tmp_path / "extended.glb").triangle_count == 2


def test_byte_order_mark(builder, tmp_path):
    builder.square()
    file = builder.write(tmp_path / "marked.gltf")
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert load(file).triangle_count == 2


@pytest.mark.parametrize(
    ("name", "message"), [("none.glb", "there is no such file"), ("", "is not a regular file")]
)
def test_no_file(tmp_path, name, message):
    with pytest.raises(GltfError, match=message):
        load(tmp_path / name)


@pytest.mark.parametrize("suffix", ["obj", "stl", "ply", "off"])
def test_other_mesh_formats_name_the_command(tmp_path, suffix):
    file = tmp_path / f"part.{suffix}"
    file.write_bytes(b"solid part\nendsolid part\n")
    with pytest.raises(GltfError, match=rf"trimesh\.load\('part\.{suffix}'\)\.export\('part\.glb'\)"):
        load(file)


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_meshopt_uses_the_fallback_buffer_where_there_is_one(builder, load_built, name):
    builder.square()
    for view in builder.document["bufferViews"]:
        view["extensions"] = {name: {"buffer": 0}}
    builder.extend(name)
    assert load_built(builder).triangle_count == 2
    builder.document["buffers"] = [{"byteLength": 60, "extensions": {name: {"fallback": True}}}]
    for view in builder.document["bufferViews"]:
        view["buffer"] = 1
    with pytest.raises(GltfError, match=rf"{name} is not supported; convert .*npx @gltf-transform/cli copy"):
        load_built(builder)


def test_unknown_required_extensions(builder, load_built):
    builder.square()
    builder.extend("KHR_texture_transform", "ACME_teapots", required=True)
    with pytest.raises(
        GltfError, match=r"extensionsRequired\[1\]: the file requires the unknown extension ACME_t"
    ):
        load_built(builder)


def test_names_with_lone_surrogates_stay_printable(builder, load_built):
    node = builder.square()
    builder.document["nodes"][node] |= {"name": "\ud800", "extensions": {"\udfff": {}}}
    scene = load_built(builder)
    for text in (scene.nodes[0].name, *scene.ignored):
        text.encode("utf-8")
