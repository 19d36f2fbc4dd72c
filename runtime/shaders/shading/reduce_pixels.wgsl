// Half the resolution: one of every 2 x 2 pixels (SDFDDGI, section 3.4, Fig. 6). Where they show several surfaces, a
// checkerboard takes the nearest here and the farthest there, so that both are kept; every fourth frame the colours
// change places. Where the four lie on one surface each of them covers its depths, and they take turns. The background
// stands for nothing.

import package::lib::frame::{frame};
import package::primary::gbuffer::{gbuffer_depth};
import package::shading::pixels::{NO_PIXEL, pixel_pack, pixel_surface, quad_offset, quad_turn, surfaces_agree};

@group(0) @binding(9) var half_pixels: texture_storage_2d<r32uint, write>;

fn quad_is_smooth(corner: vec2u) -> bool {
    let first = pixel_surface(corner);
    return surfaces_agree(first, pixel_surface(corner + quad_offset(1u)))
        && surfaces_agree(first, pixel_surface(corner + quad_offset(2u)))
        && surfaces_agree(first, pixel_surface(corner + quad_offset(3u)));
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= textureDimensions(half_pixels)) {
        return;
    }
    let corner = 2u * id.xy;
    let turn = frame.frame_index >> 2u;
    let take_nearest = ((id.x + id.y + turn) & 1u) == 0u;
    var chosen = NO_PIXEL;
    var best = 0.0;
    var covered = 0u;
    for (var i = 0u; i < 4u; i++) {
        let pixel = corner + quad_offset(i);
        // Outside of the picture a texture reads as 0, which is the background.
        let depth = select(0.0, textureLoad(gbuffer_depth, pixel, 0), all(pixel < frame.size));
        if depth <= 0.0 {
            continue;
        }
        covered++;
        if chosen == NO_PIXEL || select((depth < best), (depth > best), take_nearest) {
            chosen = pixel_pack(pixel);
            best = depth;
        }
    }
    if covered == 4u && quad_is_smooth(corner) {
        chosen = pixel_pack(corner + quad_offset(quad_turn(turn)));
    }
    textureStore(half_pixels, id.xy, vec4u(chosen));
}
