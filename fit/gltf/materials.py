"""Materials and their textures (glTF 2.0, section 3.9)."""

from __future__ import annotations

import math
from urllib.parse import unquote

import numpy as np

from fit.gltf.container import Document
from fit.gltf.extensions import BASISU_EXTENSION, CONVERSIONS, extension_remedy
from fit.gltf.images import EncodedImage, can_decode, decode_images, is_ktx2
from fit.gltf.json_object import JsonObject
from fit.gltf.notes import Notes
from fit.gltf.resources import Resources
from fit.scene import AlphaMode, Float64, Image, Material, Texture, TextureUse, Wrap

WRAPS = {10497: Wrap.REPEAT, 33648: Wrap.MIRROR, 33071: Wrap.CLAMP}
LINEAR_FILTERS = {9728: False, 9729: True}
ALPHA_MODES = {mode.value: mode for mode in AlphaMode}
PILLOW_EXTENSIONS = {"EXT_texture_webp": "WEBP", "EXT_texture_avif": "AVIF"}
BLACK = (0.0, 0.0, 0.0)


class Materials:
    """Collects the materials that meshes use, and of them the textures; each image is decoded once."""

    def __init__(self, document: Document, resources: Resources, notes: Notes) -> None:
        self.document = document
        self.resources = resources
        self.notes = notes
        self.materials: list[Material] = []
        self.textures: list[Texture] = []
        self._encoded: list[EncodedImage] = []
        self._material_numbers: dict[int | None, int] = {}
        self._texture_numbers: dict[int, int | None] = {}
        self._image_numbers: dict[int, int | None] = {}

    def use(self, index: int | None) -> int:
        """The number in `materials` of the file's material `index`; None is glTF's default material."""
        if index not in self._material_numbers:
            material = Material() if index is None else self._read(index, self.document.materials[index])
            self._material_numbers[index] = len(self.materials)
            self.materials.append(material)
        return self._material_numbers[index]

    def images(self) -> tuple[Image, ...]:
        """All images that the used textures show, decoded.

        Raises:
            GltfError: an image can't be decoded.
        """
        return decode_images(self._encoded)

    def note_unused(self) -> None:
        used = sum(index is not None for index in self._material_numbers)
        self.notes.ignore("materials that nothing drawn uses", len(self.document.materials) - used)

    def _read(self, index: int, definition: JsonObject) -> Material:
        base_color, base_texture, metallic, roughness, roughness_texture = self._surface(definition)
        strength = definition.extension("KHR_materials_emissive_strength")
        factor = 1.0 if strength is None else strength.number("emissiveStrength", 1.0, minimum=0.0)
        emission = _color(definition, "emissiveFactor", BLACK)
        transmission = definition.extension("KHR_materials_transmission")
        self._note_ignored_textures(definition, transmission)
        return Material(
            name=definition.string("name", f"material {index}"),
            base_color=base_color,
            base_color_texture=base_texture,
            metallic=metallic,
            roughness=roughness,
            metallic_roughness_texture=roughness_texture,
            emission=(emission[0] * factor, emission[1] * factor, emission[2] * factor),
            emission_texture=self._texture_use(definition, "emissiveTexture") if any(emission) else None,
            alpha_mode=definition.choice("alphaMode", ALPHA_MODES, "OPAQUE"),
            alpha_cutoff=definition.number("alphaCutoff", 0.5, minimum=0.0),
            double_sided=definition.boolean("doubleSided"),
            unlit=definition.extension("KHR_materials_unlit") is not None,
            transmission=self._unit(transmission, "transmissionFactor", 0.0) if transmission else 0.0,
        )

    def _surface(
        self, definition: JsonObject
    ) -> tuple[tuple[float, float, float, float], TextureUse | None, float, float, TextureUse | None]:
        """Base colour and its texture, metallic, roughness and their texture."""
        glossy = definition.extension("KHR_materials_pbrSpecularGlossiness")
        if glossy is not None:
            if "specularGlossinessTexture" in glossy:
                self.notes.ignore("specularGlossinessTexture")
            roughness = 1.0 - self._unit(glossy, "glossinessFactor", 1.0)
            diffuse = self._texture_use(glossy, "diffuseTexture")
            return _color4(glossy, "diffuseFactor"), diffuse, 0.0, roughness, None
        rough = definition.object("pbrMetallicRoughness")
        if rough is None:
            return (1.0, 1.0, 1.0, 1.0), None, 1.0, 1.0, None
        return (
            _color4(rough, "baseColorFactor"),
            self._texture_use(rough, "baseColorTexture"),
            self._unit(rough, "metallicFactor", 1.0),
            self._unit(rough, "roughnessFactor", 1.0),
            self._texture_use(rough, "metallicRoughnessTexture"),
        )

    def _unit(self, owner: JsonObject, key: str, default: float) -> float:
        """A factor of 0 to 1; exporters overshoot now and then."""
        value = owner.number(key, default)
        clamped = min(max(value, 0.0), 1.0)
        self.notes.repair("material factors clamped to 0 to 1", int(value != clamped))
        return clamped

    def _note_ignored_textures(self, definition: JsonObject, transmission: JsonObject | None) -> None:
        for key, factor in (("normalTexture", "scale"), ("occlusionTexture", "strength")):
            texture = definition.object(key)
            if texture is not None:
                texture.number(factor, 1.0)
                self.notes.ignore(key)
        if transmission is not None and "transmissionTexture" in transmission:
            self.notes.ignore("transmissionTexture")

    def _texture_use(self, owner: JsonObject, key: str) -> TextureUse | None:
        info = owner.object(key)
        if info is None:
            return None
        texture = self._texture(info.required_reference("index", len(self.document.textures), "textures"))
        if texture is None:
            return None
        texcoord = info.integer("texCoord", 0)
        moved = info.extension("KHR_texture_transform")
        if moved is None:
            return TextureUse(texture, texcoord)
        return TextureUse(texture, moved.integer("texCoord", texcoord), texture_transform(moved))

    def _texture(self, index: int) -> int | None:
        if index not in self._texture_numbers:
            definition = self.document.textures[index]
            image = self._image_of(definition)
            self._texture_numbers[index] = None if image is None else len(self.textures)
            if image is not None:
                self.textures.append(self._sampled(definition, image))
        return self._texture_numbers[index]

    def _image_of(self, definition: JsonObject) -> int | None:
        """The number of the image that a texture shows, None where no source can be read (which is noted).

        Raises:
            GltfError: the file requires a format that can't be read, or an image file is missing.
        """
        images = len(self.document.images)
        for name, pillow_format in PILLOW_EXTENSIONS.items():
            better = definition.extension(name)
            if better is not None and can_decode(pillow_format):
                return self._image(better.required_reference("source", images, "images"))
        compressed = definition.extension(BASISU_EXTENSION)
        source = definition.reference("source", images, "images")
        if source is not None and not (compressed is not None and self._is_missing(source)):
            return self._image(source)
        extensions = definition.object("extensions")
        for name in extensions.values if extensions else ():
            if name in self.document.extensions_required:
                raise definition.error(extension_remedy(name))
        if compressed is not None:
            self._note_ktx2()
        else:
            self.notes.ignore("textures without an image that can be read, their factor alone is used")
        return None

    def _is_missing(self, index: int) -> bool:
        """Whether an image is a file that is not there (converters to KTX2 delete what they converted)."""
        definition = self.document.images[index]
        return "bufferView" not in definition and not self.resources.has_uri(definition)

    def _note_ktx2(self) -> None:
        remedy = CONVERSIONS[BASISU_EXTENSION]
        self.notes.ignore(
            f"KTX2 textures, their factor alone is used ({BASISU_EXTENSION}; to keep them: {remedy})"
        )

    def _sampled(self, definition: JsonObject, image: int) -> Texture:
        samplers = self.document.samplers
        index = definition.reference("sampler", len(samplers), "samplers")
        if index is None:
            return Texture(image)
        sampler = samplers[index]
        return Texture(
            image,
            sampler.choice("wrapS", WRAPS, 10497),
            sampler.choice("wrapT", WRAPS, 10497),
            sampler.choice("magFilter", LINEAR_FILTERS, 9729),
        )

    def _image(self, index: int) -> int | None:
        if index not in self._image_numbers:
            encoded = self._encoded_image(index, self.document.images[index])
            if is_ktx2(encoded):
                self._note_ktx2()
                self._image_numbers[index] = None
            else:
                self._image_numbers[index] = len(self._encoded)
                self._encoded.append(encoded)
        return self._image_numbers[index]

    def _encoded_image(self, index: int, definition: JsonObject) -> EncodedImage:
        view = definition.reference("bufferView", len(self.document.buffer_views), "bufferViews")
        if view is not None:
            name = definition.string("name", f"image {index}")
            return EncodedImage(definition, name, self.resources.buffer_view(view))
        uri = definition.string("uri")
        name = f"image {index}" if uri[:5].lower() == "data:" else unquote(uri).rsplit("/", 1)[-1]
        return EncodedImage(definition, definition.string("name", name), self.resources.read_uri(definition))


def texture_transform(extension: JsonObject) -> Float64:
    """The (3, 3) matrix T R S of KHR_texture_transform; v points down, rotation is counter-clockwise."""
    offset = extension.numbers("offset", 2, (0.0, 0.0))
    scale = extension.numbers("scale", 2, (1.0, 1.0))
    rotation = extension.number("rotation", 0.0)
    c, s = math.cos(rotation), math.sin(rotation)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    move = np.array([[1.0, 0.0, offset[0]], [0.0, 1.0, offset[1]], [0.0, 0.0, 1.0]])
    return move @ turn @ np.diag([scale[0], scale[1], 1.0])


def _color(owner: JsonObject, key: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
    r, g, b = owner.numbers(key, 3, default)
    if min(r, g, b) < 0:
        raise owner.error("a colour can't be negative", key)
    return r, g, b


def _color4(owner: JsonObject, key: str) -> tuple[float, float, float, float]:
    r, g, b, a = owner.numbers(key, 4, (1.0, 1.0, 1.0, 1.0))
    if min(r, g, b, a) < 0:
        raise owner.error("a colour can't be negative", key)
    return r, g, b, a
