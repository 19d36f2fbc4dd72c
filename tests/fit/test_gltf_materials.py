"""Materials, textures, images, and the extensions that change them."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from PIL import Image as PillowImage

from fit.gltf import GltfError
from fit.gltf.images import KTX2_MAGIC, can_decode
from fit.scene import AlphaMode, Material, Wrap

RED = np.array([[[255, 0, 0, 255]]], np.uint8)


def encode(pixels, image_format="PNG", mode=None, **options):
    stream = io.BytesIO()
    picture = PillowImage.fromarray(pixels)
    (picture if mode is None else picture.convert(mode)).save(stream, image_format, **options)
    return stream.getvalue()


def add_texture(builder, data, **entry):
    image = builder.add("images", bufferView=builder.view(data), mimeType="image/png")
    return builder.add("textures", source=image, **entry)


@pytest.fixture
def load_material(builder, load_built):
    """Load a square of one material; the scene and its material."""

    def load_it(**material):
        builder.square(material=builder.add("materials", **material))
        scene = load_built(builder)
        return scene, scene.materials[scene.meshes[-1].material]

    return load_it


def base_texture(texture, **info):
    return {"baseColorTexture": {"index": texture, **info}}


def test_factors(load_material):
    scene, material = load_material(
        name="paint",
        pbrMetallicRoughness={
            "baseColorFactor": [0.1, 0.2, 0.3, 0.4],
            "metallicFactor": 0.5,
            "roughnessFactor": 0.25,
        },
        emissiveFactor=[1, 0.5, 0],
        extensions={
            "KHR_materials_emissive_strength": {"emissiveStrength": 4},
            "KHR_materials_unlit": {},
            "KHR_materials_transmission": {"transmissionFactor": 0.75},
        },
        alphaMode="MASK",
        alphaCutoff=0.3,
        doubleSided=True,
    )
    assert material == Material(
        name="paint",
        base_color=(0.1, 0.2, 0.3, 0.4),
        metallic=0.5,
        roughness=0.25,
        emission=(4, 2, 0),
        alpha_mode=AlphaMode.MASK,
        alpha_cutoff=0.3,
        double_sided=True,
        unlit=True,
        transmission=0.75,
    )
    assert scene.ignored == ()


def test_defaults(load_material):
    assert load_material()[1] == Material(name="material 0")


def test_no_material_is_the_default_one(builder, load_built):
    builder.add("materials", name="unused")
    builder.square()
    scene = load_built(builder)
    assert scene.materials == (Material(),)
    assert scene.ignored == ("materials that nothing drawn uses: 1",)


def test_specular_glossiness_is_read_as_its_diffuse_colour(builder, load_material):
    texture = add_texture(builder, encode(RED))
    glossy = {
        "diffuseFactor": [0.2, 0.4, 0.6, 1],
        "diffuseTexture": {"index": texture},
        "glossinessFactor": 0.7,
    }
    _, material = load_material(
        pbrMetallicRoughness={"baseColorFactor": [1, 0, 0, 1]},
        extensions={"KHR_materials_pbrSpecularGlossiness": glossy},
    )
    assert material.base_color == (0.2, 0.4, 0.6, 1)
    assert material.base_color_texture.texture == 0
    assert (material.metallic, round(material.roughness, 12)) == (0, 0.3)


def test_factors_out_of_range_are_clamped_and_counted(load_material):
    scene, material = load_material(pbrMetallicRoughness={"metallicFactor": 1.0000001, "roughnessFactor": -1})
    assert (material.metallic, material.roughness) == (1, 0)
    assert scene.repairs["material factors clamped to 0 to 1"] == 2


def test_textures_share_an_image_decoded_once(builder, load_material):
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
    first = add_texture(builder, encode(pixels), sampler=0)
    second = builder.add("textures", source=0, sampler=1)
    builder.add("samplers", wrapS=33071, wrapT=33648, magFilter=9728)
    builder.add("samplers")
    scene, material = load_material(
        pbrMetallicRoughness={
            "baseColorTexture": {"index": first},
            "metallicRoughnessTexture": {"index": second, "texCoord": 1},
        }
    )
    assert len(scene.images) == 1
    assert np.array_equal(scene.images[0].pixels, pixels)
    nearest, linear = scene.textures
    assert (nearest.wrap_u, nearest.wrap_v, nearest.linear) == (Wrap.CLAMP, Wrap.MIRROR, False)
    assert (linear.wrap_u, linear.wrap_v, linear.linear) == (Wrap.REPEAT, Wrap.REPEAT, True)
    assert (material.base_color_texture.texture, material.metallic_roughness_texture.texture) == (0, 1)
    assert material.metallic_roughness_texture.texcoord == 1


def test_only_images_that_are_used_are_decoded(builder, load_material):
    broken = add_texture(builder, b"not an image")
    scene, _ = load_material(
        normalTexture={"index": broken},
        occlusionTexture={"index": broken},
        emissiveTexture={"index": broken},
        emissiveFactor=[0, 0, 0],
    )
    assert scene.images == ()
    assert set(scene.ignored) == {"normalTexture: 1", "occlusionTexture: 1"}


def test_texture_transform_follows_the_example_of_its_specification(builder, load_material):
    """The extension's first example: the lower left quadrant of the image, turned clockwise by 90 degrees."""
    texture = add_texture(builder, encode(RED))
    transform = {"offset": [0, 1], "rotation": math.pi / 2, "scale": [0.5, 0.5], "texCoord": 3}
    _, material = load_material(
        pbrMetallicRoughness=base_texture(texture, extensions={"KHR_texture_transform": transform})
    )
    use = material.base_color_texture
    assert use.texcoord == 3
    corners = np.array([[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]], float)
    assert np.allclose((corners @ use.transform.T)[:, :2], [[0, 1], [0, 0.5], [0.5, 1], [0.5, 0.5]])


def test_texture_transform_scales_before_it_turns(builder, load_material):
    texture = add_texture(builder, encode(RED))
    transform = {"rotation": math.pi / 2, "scale": [2, 3]}
    info = base_texture(texture, texCoord=1, extensions={"KHR_texture_transform": transform})
    use = load_material(pbrMetallicRoughness=info)[1].base_color_texture
    assert use.texcoord == 1
    assert np.allclose(use.transform @ (1, 1, 1), (3, -2, 1))


GREY = np.linspace(0, 255, 16).astype(np.uint8).reshape(4, 4)
COLORS = np.random.default_rng(0).integers(0, 256, (4, 4, 3), dtype=np.uint8)


def opaque(colors):
    return np.concatenate([colors, np.full((*colors.shape[:2], 1), 255, np.uint8)], axis=2)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (encode(COLORS), opaque(COLORS)),
        (encode(GREY), opaque(np.repeat(GREY[:, :, None], 3, axis=2))),
        (encode(GREY.astype(np.uint16) * 257), opaque(np.repeat(GREY[:, :, None], 3, axis=2))),
        (encode(COLORS // 128 * 255, mode="P"), opaque(COLORS // 128 * 255)),
        (
            encode((GREY > 127) * np.uint8(255), mode="1"),
            opaque(np.repeat((GREY[:, :, None] > 127) * np.uint8(255), 3, 2)),
        ),
        (encode(np.dstack([GREY, GREY // 2]), mode="LA"), np.dstack([GREY, GREY, GREY, GREY // 2])),
    ],
    ids=["rgb", "grey", "grey16", "palette", "one bit", "grey and alpha"],
)
def test_png_kinds(builder, load_material, data, expected):
    scene, _ = load_material(pbrMetallicRoughness=base_texture(add_texture(builder, data)))
    assert np.array_equal(scene.images[0].pixels, expected)


def test_palette_with_transparency(builder, load_material):
    picture = PillowImage.new("P", (2, 1))
    picture.putpalette([255, 0, 0, 0, 255, 0])
    picture.putpixel((1, 0), 1)
    stream = io.BytesIO()
    picture.save(stream, "PNG", transparency=bytes([0, 255]))
    scene, _ = load_material(pbrMetallicRoughness=base_texture(add_texture(builder, stream.getvalue())))
    assert np.array_equal(scene.images[0].pixels, [[[255, 0, 0, 0], [0, 255, 0, 255]]])


@pytest.mark.parametrize("mode", ["RGB", "L", "CMYK"])
def test_jpeg(builder, load_material, mode):
    flat = np.full((8, 8, 3), (200, 200, 200), np.uint8)
    data = encode(flat, "JPEG", mode=mode, quality=95)
    scene, _ = load_material(pbrMetallicRoughness=base_texture(add_texture(builder, data)))
    assert np.abs(scene.images[0].pixels.astype(int) - (200, 200, 200, 255)).max() <= 3


@pytest.mark.parametrize(
    ("extension", "pillow_format"), [("EXT_texture_webp", "WEBP"), ("EXT_texture_avif", "AVIF")]
)
def test_webp_and_avif_come_before_their_fallback(builder, load_material, extension, pillow_format):
    if not can_decode(pillow_format):
        pytest.skip(f"this Pillow was built without {pillow_format}")
    better = builder.add(
        "images", bufferView=builder.view(encode(RED.repeat(8, 0).repeat(8, 1), pillow_format))
    )
    texture = add_texture(builder, encode(RED * 0), extensions={extension: {"source": better}})
    scene, _ = load_material(pbrMetallicRoughness=base_texture(texture))
    assert len(scene.images) == 1
    assert scene.images[0].pixels[0, 0, 0] > 240


def test_webp_without_a_decoder_falls_back(builder, load_material, monkeypatch):
    monkeypatch.setattr("fit.gltf.materials.can_decode", lambda name: False)
    better = builder.add("images", bufferView=builder.view(b"never read"))
    texture = add_texture(builder, encode(RED), extensions={"EXT_texture_webp": {"source": better}})
    scene, _ = load_material(pbrMetallicRoughness=base_texture(texture))
    assert np.array_equal(scene.images[0].pixels, RED)


def test_webp_without_a_decoder_or_fallback_names_the_command(builder, load_material, monkeypatch):
    monkeypatch.setattr("fit.gltf.materials.can_decode", lambda name: False)
    builder.extend("EXT_texture_webp", required=True)
    better = builder.add("images", bufferView=builder.view(b"never read"))
    texture = builder.add("textures", extensions={"EXT_texture_webp": {"source": better}})
    with pytest.raises(GltfError, match=r"textures\[0\]: EXT_texture_webp .* `npx @gltf-transform/cli png"):
        load_material(pbrMetallicRoughness=base_texture(texture))


def basisu_texture(builder, **entry):
    ktx2 = builder.add("images", bufferView=builder.view(KTX2_MAGIC + bytes(64)), mimeType="image/ktx2")
    return builder.add("textures", extensions={"KHR_texture_basisu": {"source": ktx2}}, **entry)


def test_ktx2_with_a_fallback_uses_it(builder, load_material):
    fallback = builder.add("images", bufferView=builder.view(encode(RED)))
    scene, _ = load_material(pbrMetallicRoughness=base_texture(basisu_texture(builder, source=fallback)))
    assert np.array_equal(scene.images[0].pixels, RED)
    assert scene.ignored == ()


@pytest.mark.parametrize("missing_fallback", [True, False])
def test_optional_ktx2_without_a_fallback_leaves_the_factor(builder, load_material, missing_fallback):
    entry = {"source": builder.add("images", uri="gone.png")} if missing_fallback else {}
    scene, material = load_material(pbrMetallicRoughness=base_texture(basisu_texture(builder, **entry)))
    assert material.base_color_texture is None
    assert scene.images == ()
    assert len(scene.ignored) == 1
    assert "KTX2 textures" in scene.ignored[0]
    assert "npx @gltf-transform/cli ktxdecompress" in scene.ignored[0]


def test_required_ktx2_names_the_command(builder, load_material):
    builder.extend("KHR_texture_basisu", required=True)
    with pytest.raises(GltfError, match=r"KHR_texture_basisu .*`npx @gltf-transform/cli ktxdecompress"):
        load_material(pbrMetallicRoughness=base_texture(basisu_texture(builder)))


def test_ktx2_as_a_plain_source_leaves_the_factor(builder, load_material):
    scene, material = load_material(
        pbrMetallicRoughness=base_texture(add_texture(builder, KTX2_MAGIC + bytes(64)))
    )
    assert material.base_color_texture is None
    assert "KTX2 textures" in scene.ignored[0]


def test_texture_without_a_source_is_listed(builder, load_material):
    scene, material = load_material(pbrMetallicRoughness=base_texture(builder.add("textures")))
    assert material.base_color_texture is None
    assert scene.ignored == ("textures without an image that can be read, their factor alone is used: 1",)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"GIF89a not one of glTF's formats", "is not a PNG, JPEG, WebP or AVIF image"),
        (encode(np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8))[:900], "can't be decoded"),
        (
            encode(np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8), "JPEG")[:500],
            "can't be decoded",
        ),
        (b"", "is not a PNG, JPEG, WebP or AVIF image"),
    ],
)
def test_unreadable_images_are_errors(builder, load_material, data, message):
    with pytest.raises(GltfError, match=r"images\[0\]: ") as caught:
        load_material(pbrMetallicRoughness=base_texture(add_texture(builder, data)))
    assert message in str(caught.value)


def test_image_bombs_are_refused_before_they_are_decoded(builder, load_material):
    stream = io.BytesIO()
    PillowImage.new("1", (9000, 9000)).save(stream, "PNG")
    with pytest.raises(GltfError, match=r"images\[0\]: 9000 x 9000 pixels are too many"):
        load_material(pbrMetallicRoughness=base_texture(add_texture(builder, stream.getvalue())))


def test_missing_image_file(builder, load_material):
    texture = builder.add("textures", source=builder.add("images", uri="no%20such.png"))
    with pytest.raises(
        GltfError, match=r"images\[0\]\.uri: 'no such\.png' is missing; put it beside built\.glb"
    ):
        load_material(pbrMetallicRoughness=base_texture(texture))


@pytest.mark.parametrize(
    ("material", "message"),
    [
        ({"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1]}}, "baseColorFactor: must be an array of 4"),
        ({"pbrMetallicRoughness": {"baseColorFactor": [1, 1, -1, 1]}}, "a colour can't be negative"),
        ({"pbrMetallicRoughness": {"baseColorTexture": {}}}, "baseColorTexture.index: required but missing"),
        ({"pbrMetallicRoughness": base_texture(3)}, "index 3 points past the end, there are 0 textures"),
        ({"alphaMode": "GLASS"}, "alphaMode: 'GLASS' is not one of OPAQUE, MASK, BLEND"),
        ({"alphaCutoff": "half"}, "alphaCutoff: must be a finite number, not 'half'"),
        ({"doubleSided": 1}, "doubleSided: must be true or false"),
        ({"emissiveFactor": None}, "emissiveFactor: must be an array, not None"),
        ({"extensions": []}, "extensions: must be an object"),
    ],
)
def test_damaged_materials(load_material, material, message):
    with pytest.raises(GltfError, match=r"materials\[0\]") as caught:
        load_material(**material)
    assert message in str(caught.value)


def test_extensions_that_are_not_read_are_counted(builder, load_material):
    builder.extend("KHR_materials_clearcoat", "KHR_materials_variants", "ACME_unused")
    scene, _ = load_material(extensions={"KHR_materials_clearcoat": {}})
    assert set(scene.ignored) == {
        "extension ACME_unused: 1",
        "extension KHR_materials_clearcoat: 1",
        "extension KHR_materials_variants: 1",
    }
    assert scene.extensions == ("KHR_materials_clearcoat", "KHR_materials_variants", "ACME_unused")
