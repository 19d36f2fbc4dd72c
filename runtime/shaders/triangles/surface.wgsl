// What a point of a triangle looks like: filtered textures times vertex colours and factors.

import package::lib::color::{color_linear_from_srgb};
import package::lib::normal::{normal_unpack};
import package::structs::{TriangleImage};
import package::triangles::bindings::{triangle_corners, triangle_faces, triangle_images, triangle_materials, triangle_texels};

const NO_IMAGE: u32 = 0xffffffffu;
const WRAP_REPEAT: u32 = 0u;
const WRAP_MIRROR: u32 = 1u;

struct TriangleSurface {
    // Interpolated and unit, on the side that the vertices say.
    normal: vec3f,
    albedo: vec3f,
    emission: vec3f,
    is_double_sided: bool,
}

fn surface_material(triangle: u32) -> u32 {
    return bitcast<u32>(triangle_faces[3u * triangle].w);
}

fn surface_wrapped(texel: i32, size: i32, wrap: u32) -> i32 {
    if wrap == WRAP_REPEAT {
        return (texel % size + size) % size;
    }
    if wrap == WRAP_MIRROR {
        let place = (texel % (2 * size) + 2 * size) % (2 * size);
        return min(place, 2 * size - 1 - place);
    }
    return clamp(texel, 0, size - 1);
}

// Colour is linear, alpha as stored.
fn surface_texel(image: TriangleImage, texel: vec2i) -> vec4f {
    let x = surface_wrapped(texel.x, i32(image.width), image.wrap_u);
    let y = surface_wrapped(texel.y, i32(image.height), image.wrap_v);
    let stored = unpack4x8unorm(triangle_texels[image.first + u32(y) * image.width + u32(x)]);
    return vec4f(color_linear_from_srgb(stored.rgb), stored.a);
}

fn surface_texture(index: u32, uv: vec2f) -> vec4f {
    if index == NO_IMAGE {
        return vec4f(1.0);
    }
    let image = triangle_images[index];
    let place = uv * vec2f(f32(image.width), f32(image.height));
    if image.is_linear == 0u {
        return surface_texel(image, vec2i(floor(place)));
    }
    let corner = floor(place - 0.5);
    let share = place - 0.5 - corner;
    let at = vec2i(corner);
    let top = mix(surface_texel(image, at), surface_texel(image, at + vec2i(1, 0)), share.x);
    let bottom = mix(surface_texel(image, at + vec2i(0, 1)), surface_texel(image, at + vec2i(1, 1)), share.x);
    return mix(top, bottom, share.y);
}

// Weights of the corners at (u, v) along the two edges.
fn surface_weights(place: vec2f) -> vec3f {
    return vec3f(1.0 - place.x - place.y, place);
}

fn surface_base_color(triangle: u32, place: vec2f) -> vec4f {
    let material = triangle_materials[surface_material(triangle)];
    let weights = surface_weights(place);
    var uv = vec2f(0.0);
    var color = vec4f(0.0);
    for (var k = 0u; k < 3u; k++) {
        let corner = triangle_corners[3u * triangle + k];
        uv += weights[k] * corner.base_uv;
        color += weights[k] * unpack4x8unorm(corner.color);
    }
    return surface_texture(material.base_image, uv) * color * material.base_color;
}

// Whether a ray passes through the point: masked and blended surfaces are cut at their filtered alpha.
fn surface_is_open(triangle: u32, place: vec2f) -> bool {
    let cutoff = triangle_materials[surface_material(triangle)].alpha_cutoff;
    return cutoff > 0.0 && surface_base_color(triangle, place).a < cutoff;
}

fn surface_at(triangle: u32, place: vec2f) -> TriangleSurface {
    let material = triangle_materials[surface_material(triangle)];
    let weights = surface_weights(place);
    var normal = vec3f(0.0);
    var uv = vec2f(0.0);
    for (var k = 0u; k < 3u; k++) {
        let corner = triangle_corners[3u * triangle + k];
        normal += weights[k] * normal_unpack(corner.normal);
        uv += weights[k] * corner.emission_uv;
    }
    let emission = surface_texture(material.emission_image, uv).rgb * material.emission;
    let albedo = clamp(surface_base_color(triangle, place).rgb, vec3f(0.0), vec3f(1.0));
    return TriangleSurface(normalize(normal), albedo, emission, material.is_double_sided != 0u);
}
