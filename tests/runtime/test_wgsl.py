"""The shader loader: imports, names, bindings, and errors that point into the files people wrote."""

from __future__ import annotations

import itertools
import re

import pytest

from runtime import wgsl, wgsl_syntax
from runtime.kernel import Kernel, compile_module
from runtime.wgsl import Binding, WgslError, load

KERNEL = "@compute @workgroup_size(8)\nfn main() {}\n"


def test_a_module_is_spliced_once_and_before_those_that_ask_for_it(shaders):
    root = shaders(
        {
            "lib/base": "const BASE = 1.0;\n",
            "lib/left": "import package::lib::base::{BASE};\nfn left() -> f32 { return BASE; }\n",
            "lib/right": "import package::lib::base::{BASE};\nfn right() -> f32 { return BASE; }\n",
            "add": "import package::lib::left::{left};\n"
            "import package::lib::right::{\n    right,\n};\n"
            "fn sum() -> f32 { return left() + right(); }\n" + KERNEL,
        }
    )
    shader = load("add", root=root)
    assert shader.code.count("const BASE") == 1
    order = [shader.code.index(word) for word in ("const BASE", "fn left", "fn right", "fn sum")]
    assert order == sorted(order)
    assert "import" not in shader.code


def test_every_line_remembers_its_file(shaders):
    root = shaders(
        {
            "lib/base": "// first\n\n/* two\nlines */\nconst BASE = 1.0;\n",
            "add": "\nimport package::lib::base::{BASE};\n\nconst MORE = BASE;\n" + KERNEL,
        }
    )
    shader = load("add", root=root)
    lines = shader.code.splitlines()
    assert len(lines) == len(shader.line_map)
    for line, (path, number) in zip(lines, shader.line_map, strict=True):
        assert path.read_text(encoding="utf-8").splitlines()[number - 1] == line
    assert shader.locate(lines.index("const MORE = BASE;") + 1) == f"{root / 'add.wgsl'}:4"


def test_an_alias_stands_for_a_folder(shaders):
    root = shaders(
        {
            "none/lookup": "fn gi_irradiance() -> f32 { return 0.0; }\n",
            "some/lookup": "fn gi_irradiance() -> f32 { return 1.0; }\n",
            "shade": "import package::technique::lookup::{gi_irradiance};\n" + KERNEL,
        }
    )
    assert "return 1.0" in load("shade", {"technique": "some"}, root).code
    assert "return 0.0" in load("shade", {"technique": "none"}, root).code
    with pytest.raises(WgslError, match=r"shade\.wgsl:1: there is no module .*aliases=\{'technique'"):
        load("shade", root=root)


def test_only_the_structs_that_are_needed_are_spliced(shaders):
    structs = "struct Ray { origin: vec3f }\nstruct Hit { ray: Ray, t: f32 }\nstruct Sky { color: vec3f }\n"
    root = shaders({"structs": structs, "trace": "import package::structs::{Hit};\n" + KERNEL})
    code = load("trace", root=root).code
    assert "struct Hit" in code
    assert "struct Ray" in code
    assert "struct Sky" not in code


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (
            {"lib/a": "fn a() {}\n", "k": "\nimport package::lib::a::{a, b};\n" + KERNEL},
            r"k\.wgsl:2: .*a\.wgsl declares no b",
        ),
        ({"k": "import package::lib::a::{a};\n" + KERNEL}, r"k\.wgsl:1: there is no module .*lib/a\.wgsl"),
        ({"k": "import lib::a::{a};\n" + KERNEL}, r"k\.wgsl:1: an import reads"),
        ({"k": "import package::lib::a::{a}\n" + KERNEL}, r"k\.wgsl:1: an import reads"),
        (
            {
                "lib/a": "import package::lib::b::{b};\nfn a() {}\n",
                "lib/b": "\nimport package::lib::a::{a};\nfn b() {}\n",
                "k": "import package::lib::a::{a};\n" + KERNEL,
            },
            r"b\.wgsl:2: imports run in a circle: lib::a -> lib::b -> lib::a",
        ),
        (
            {
                "lib/a": "fn clamped() {}\n",
                "k": "import package::lib::a::{clamped};\n\nfn clamped() {}\n" + KERNEL,
            },
            r"k\.wgsl:3: clamped is declared in .*lib/a\.wgsl:1 too",
        ),
        (
            {
                "lib/a": "fn one() {}\nfn two() {}\n",
                "k": "import package::lib::a::{one};\nfn f() { one();\n two(); }\n" + KERNEL,
            },
            r"k\.wgsl:3: two of .*lib/a\.wgsl is called but not imported",
        ),
        (
            {
                "lib/a": "@group(1) @binding(2) var<uniform> one: vec4f;\n",
                "k": "import package::lib::a::{one};\n@group(1) @binding(2) var two: sampler;\n" + KERNEL,
            },
            r"k\.wgsl:2: two takes @group\(1\) @binding\(2\) of one in .*lib/a\.wgsl:1",
        ),
        (
            {"k": "const SLOT = 1;\n@group(0) @binding(SLOT) var a: sampler;\n" + KERNEL},
            r"k\.wgsl:2: a: @group and @binding take plain numbers",
        ),
        (
            {"k": "\n@group(0) @binding(0) var a: texture_external;\n" + KERNEL},
            r"k\.wgsl:2: a: texture_external cannot be bound",
        ),
        (
            {"k": KERNEL + "@compute @workgroup_size(1)\nfn other() {}\n"},
            r"k\.wgsl:4: other: .* entry point, main",
        ),
    ],
)
def test_faults_name_file_and_line(shaders, texts, message):
    with pytest.raises(WgslError, match=message):
        load("k", root=shaders(texts))


def test_bindings_are_read_from_the_text(shaders):
    text = """
// @group(0) @binding(9) var ignored: sampler;
@group(0) @binding(0) var<uniform> frame: vec4f;
@group(0) @binding(1) var<storage> probes: array<vec4f>;
@binding(2) @group(0)
var<storage, read_write> counts: array<atomic<u32>, 4>;
@group(1) @binding(0) var albedo: texture_2d<f32>;
@group(1) @binding(1) var distances: texture_3d<f32>;
@group(1) @binding(2) var linear: sampler;
@group(1) @binding(3) var shadow_sampler: sampler_comparison;
@group(2) @binding(0) var shadow: texture_depth_2d_array;
@group(2) @binding(1) var ids: texture_2d<u32>;
@group(2) @binding(2) var picture: texture_storage_2d<rgba16float, write>;
@group(2) @binding(3) var volume: texture_storage_3d<r32uint, read_write>;
var<workgroup> shared_sum: array<f32, 64>;
var<private> state: u32;

@compute @workgroup_size(4, 4)
fn main() {
    let a = textureSampleLevel(albedo, linear, vec2f(0.5), 0.0);
    let d = textureLoad(distances, vec3u(0), 0).x + f32(textureDimensions(distances).x);
}
"""
    shader = load("k", root=shaders({"k": text}))
    found = {
        binding.name: (binding.group, binding.index, binding.kind, binding.access, binding.dimension)
        for binding in shader.bindings
    }
    assert found == {
        "frame": (0, 0, "uniform", None, None),
        "probes": (0, 1, "storage", "read", None),
        "counts": (0, 2, "storage", "read_write", None),
        "albedo": (1, 0, "texture", None, "2d"),
        "distances": (1, 1, "texture", None, "3d"),
        "linear": (1, 2, "sampler", None, None),
        "shadow_sampler": (1, 3, "sampler", None, None),
        "shadow": (2, 0, "texture", None, "2d-array"),
        "ids": (2, 1, "texture", None, "2d"),
        "picture": (2, 2, "storage_texture", "write", "2d"),
        "volume": (2, 3, "storage_texture", "read_write", "3d"),
    }
    by_name: dict[str, Binding] = {binding.name: binding for binding in shader.bindings}
    assert by_name["albedo"].sample_type == "float"  # sampled
    assert by_name["distances"].sample_type == "unfilterable-float"  # only loaded
    assert by_name["shadow"].sample_type == "depth"
    assert by_name["ids"].sample_type == "uint"
    assert by_name["picture"].format == "rgba16float"
    assert by_name["shadow_sampler"].comparison
    assert not by_name["linear"].comparison
    assert shader.entry_points == {"compute": "main"}


def test_workgroup_sizes_follow_the_overrides(shaders):
    text = (
        "override SIDE: u32 = 4u;\noverride LAYERS: u32;\nconst AREA = HALF * 2;\nconst HALF = 3u;\n"
        "@compute @workgroup_size(SIDE * 2, AREA, LAYERS)\nfn main() {}\n"
    )
    shader = load("k", root=shaders({"k": text}))
    assert shader.workgroup_size_with({"LAYERS": 2}) == (8, 6, 2)
    assert shader.workgroup_size_with({"LAYERS": 1, "SIDE": 16}) == (32, 6, 1)
    assert [(entry.name, entry.default) for entry in shader.overrides] == [("SIDE", "4u"), ("LAYERS", None)]
    with pytest.raises(WgslError, match=r"k\.wgsl:5: @workgroup_size.*LAYERS"):
        _ = shader.workgroup_size


def test_comments_hide_what_is_in_them():
    text = "a /* b /* c */ d */ e // f /* g\nh // i */ j\n/* // */ k"
    assert wgsl_syntax.without_comments(text).split() == ["a", "e", "h", "k"]
    assert len(wgsl_syntax.without_comments(text)) == len(text)


def test_a_commented_import_is_no_import(shaders):
    root = shaders(
        {"k": "// import package::lib::gone::{x};\n/*\nimport package::lib::gone::{x};\n*/\n" + KERNEL}
    )
    assert load("k", root=root).bindings == ()


BROKEN = {
    "an unknown name": ("fn broken(x: f32) -> f32 {\n    return x * missing;\n}\n", 2, "missing"),
    "a syntax error": ("fn broken(x: f32) -> f32 {\n\n    return x * ;\n}\n", 3, "expected expression"),
    "a type error": (
        "// why\nfn broken(x: f32) -> f32 {\n    let y = x;\n    return u32(y);\n}\n",
        4,
        "type",
    ),
}


@pytest.mark.parametrize("fault", BROKEN)
def test_a_compile_error_names_the_original_line(gpu, shaders, fault):
    text, line, words = BROKEN[fault]
    calling = "import package::lib::broken::{broken};\n\n" + KERNEL.replace("{}", "{ let y = broken(1.0); }")
    root = shaders({"lib/other": "fn fine() {}\n\n\n\n", "lib/broken": text, "k": calling})
    with pytest.raises(WgslError, match=words) as error:
        Kernel(gpu, "k", root=root)
    assert str(error.value).startswith(f"{root / 'lib/broken.wgsl'}:{line}: k: ")


def test_an_error_in_the_pipeline_is_a_shader_error_too(gpu, shaders):
    text = "@group(0) @binding(0) var<storage, read> a: array<u32>;\noverride N: u32 = 0;\n"
    text += "@compute @workgroup_size(N)\nfn main() { _ = a[0]; }\n"
    with pytest.raises(WgslError, match="k: "):
        Kernel(gpu, "k", root=shaders({"k": text}))


def folders_imported_by(name: str) -> set[str]:
    """Folders of the module's imports, and of theirs; an alias counts as one."""
    path = wgsl.SHADERS / f"{name}.wgsl"
    if not path.is_file():
        return set()
    text = path.read_text(encoding="utf-8")
    imports = re.findall(r"^import package::(?:(\w+)::)?(\w+)::\{", text, re.MULTILINE)
    found = {folder for folder, _ in imports if folder}
    return found.union(*(folders_imported_by("/".join(filter(None, parts))) for parts in imports))


def kernels_of_the_product() -> list[tuple[str, str, str]]:
    """(module, technique, tracer) for every WGSL file, with each of both where the file asks for one.

    Only ddgi's lookup traces nothing, and so goes with the tracer of triangles.
    """
    places = {
        "technique": sorted(path.parent.name for path in wgsl.SHADERS.glob("*/lookup.wgsl")),
        "tracer": sorted(path.parent.name for path in wgsl.SHADERS.glob("*/sights.wgsl")),
    }
    found: list[tuple[str, str, str]] = []
    for path in sorted(wgsl.SHADERS.rglob("*.wgsl")):
        name = path.relative_to(wgsl.SHADERS).with_suffix("").as_posix()
        asked = folders_imported_by(name)
        choices = [places[alias] if alias in asked else [""] for alias in places]
        if path.parent.name in places["tracer"]:
            choices[1] = [path.parent.name]
        elif "tracer" in asked and "sdfddgi" in asked:
            choices[1] = ["world"]
        found += [(name, *pair) for pair in itertools.product(*choices) if pair != ("sdfddgi", "triangles")]
    return found


@pytest.mark.parametrize(("name", "technique", "tracer"), kernels_of_the_product())
def test_every_shader_of_the_product_compiles(gpu, name, technique, tracer):
    aliases = {alias: module for alias, module in (("technique", technique), ("tracer", tracer)) if module}
    shader = load(name, aliases)
    if "compute" in shader.entry_points:
        needed = {entry.name: 1 for entry in shader.overrides if entry.default is None}
        kernel = Kernel(gpu, name, aliases=aliases, constants=needed)
        assert kernel.workgroup_size[0] >= 1
    else:
        assert compile_module(gpu, shader) is not None
