// A quarter of the resolution: one of every 2 x 2 pixels of half the resolution, another one each frame (SDFDDGI,
// section 3.4). Every second block then gives its choice up for a surface that neither it nor its neighbours have
// chosen, so that the whole range of depths is covered.

import package::lib::frame::{frame};
import package::shading::pixels::{
    NO_PIXEL, PixelSurface, pixel_surface, pixel_unpack, quad_offset, quad_turn, surfaces_agree,
};

@group(0) @binding(9) var half_pixels: texture_2d<u32>;
@group(0) @binding(10) var sample_pixels: texture_storage_2d<r32uint, write>;

fn half_pixel(place: vec2u) -> u32 {
    if any(place >= textureDimensions(half_pixels)) {
        return NO_PIXEL;
    }
    return textureLoad(half_pixels, place, 0).x;
}

// The corner whose turn it is, or the next one that shows a surface.
fn first_choice(block: vec2u) -> u32 {
    for (var i = 0u; i < 4u; i++) {
        let pixel = half_pixel(2u * block + quad_offset(quad_turn(frame.frame_index + i)));
        if pixel != NO_PIXEL {
            return pixel;
        }
    }
    return NO_PIXEL;
}

// Whether the choice of a block (or of none, outside of the picture) shows this surface.
fn block_shows(block: vec2i, surface: PixelSurface) -> bool {
    if any(block < vec2i(0)) {
        return false;
    }
    let pixel = first_choice(vec2u(block));
    return pixel != NO_PIXEL && surfaces_agree(surface, pixel_surface(pixel_unpack(pixel)));
}

fn is_covered(block: vec2i, surface: PixelSurface) -> bool {
    return block_shows(block, surface)
        || block_shows(block + vec2i(1, 0), surface) || block_shows(block - vec2i(1, 0), surface)
        || block_shows(block + vec2i(0, 1), surface) || block_shows(block - vec2i(0, 1), surface);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= textureDimensions(sample_pixels)) {
        return;
    }
    var chosen = first_choice(id.xy);
    if ((id.x + id.y + frame.frame_index) & 1u) == 1u {
        for (var i = 0u; i < 4u; i++) {
            let pixel = half_pixel(2u * id.xy + quad_offset(i));
            if pixel != NO_PIXEL && !is_covered(vec2i(id.xy), pixel_surface(pixel_unpack(pixel))) {
                chosen = pixel;
                break;
            }
        }
    }
    textureStore(sample_pixels, id.xy, vec4u(chosen));
}
