// Which pixels stand for others: how they are named, the order in which four take turns, and what is one surface.

import package::lib::frame::{frame_position};
import package::lib::surfaces::{surface_rise};
import package::primary::gbuffer::{gbuffer_depth, gbuffer_normal};
import package::structs::{ShadingInfo};

@group(0) @binding(8) var<storage, read> shading: ShadingInfo;

// Where all four are background.
const NO_PIXEL: u32 = 0xffffffffu;

// Corners of a quad in the order of their turns, two bits each: every second one is diagonal to the one before.
const TURNS: u32 = 0x9cu;

struct PixelSurface {
    position: vec3f,
    normal: vec3f,
}

fn pixel_pack(pixel: vec2u) -> u32 {
    return pixel.x | (pixel.y << 16u);
}

fn pixel_unpack(packed: u32) -> vec2u {
    return vec2u(packed & 0xffffu, packed >> 16u);
}

// Where a corner of a quad lies, 0 to 3, row by row.
fn quad_offset(corner: u32) -> vec2u {
    return vec2u(corner & 1u, corner >> 1u);
}

fn quad_turn(turn: u32) -> u32 {
    return (TURNS >> (2u * (turn & 3u))) & 3u;
}

fn pixel_surface(pixel: vec2u) -> PixelSurface {
    return PixelSurface(frame_position(pixel, textureLoad(gbuffer_depth, pixel, 0)), gbuffer_normal(pixel));
}

// Whether two points belong to one smooth surface: their normals are alike, and the way between them runs along it.
fn surfaces_agree(a: PixelSurface, b: PixelSurface) -> bool {
    let way = b.position - a.position;
    return dot(a.normal, b.normal) >= shading.normal_agreement
        && surface_rise(way, a.normal, b.normal) <= shading.slope * length(way) + shading.slack;
}
