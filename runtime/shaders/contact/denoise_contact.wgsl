// Openness and near light, denoised as one vector (SDFDDGI, section 3.5). In space: the 4 x 4 texels whose slices are turned
// evenly, bilaterally. In time: the mean of up to `history_frames` frames, whose past is clipped to what the texel's
// surroundings show now, so that nothing trails behind what moves.

import package::contact::info::{contact, contact_pixel};
import package::contact::likeness::{Guide, guide_of, likeness};
import package::primary::gbuffer::{gbuffer_depth};

@group(0) @binding(9) var contact_gathered: texture_2d<f32>;
@group(0) @binding(10) var contact_sources: texture_2d<f32>;
@group(0) @binding(11) var contact_moved: texture_2d<f32>;
@group(0) @binding(12) var contact_denoised: texture_storage_2d<rgba32float, write>;

// Frames averaged.
@group(0) @binding(13) var contact_frames: texture_storage_2d<r32float, write>;

// Five texels a side, of which the outermost count half: each of the 4 x 4 turns counts once.
const RADIUS: i32 = 2;
const TILE: u32 = 12u;

var<workgroup> tile_gathered: array<vec4f, 144>;
var<workgroup> tile_position: array<vec3f, 144>;
var<workgroup> tile_normal: array<vec3f, 144>;

struct Surroundings {
    mean: vec4f,
    deviation: vec4f,
}

fn load_tile(corner: vec2i, thread: u32) {
    for (var i = thread; i < TILE * TILE; i += 64u) {
        let wanted = corner + vec2i(vec2u(i % TILE, i / TILE));
        let texel = vec2u(clamp(wanted, vec2i(0), vec2i(contact.size) - 1));
        var guide = guide_of(contact_pixel(texel));
        if any(vec2i(texel) != wanted) {
            guide.normal = vec3f(0.0);
        }
        tile_gathered[i] = textureLoad(contact_gathered, texel, 0);
        tile_position[i] = guide.position;
        tile_normal[i] = guide.normal;
    }
    workgroupBarrier();
}

fn look_around(own: vec2u) -> Surroundings {
    let middle = own.x + TILE * own.y;
    let guide = Guide(tile_position[middle], tile_normal[middle]);
    var filtered = vec4f(0.0);
    var sum = vec4f(0.0);
    var squares = vec4f(0.0);
    var weights = vec2f(0.0);
    for (var y = -RADIUS; y <= RADIUS; y++) {
        for (var x = -RADIUS; x <= RADIUS; x++) {
            let other = u32(i32(own.x) + x + i32(TILE) * (i32(own.y) + y));
            let value = tile_gathered[other];
            let alike = likeness(guide, Guide(tile_position[other], tile_normal[other]));
            let box = select(1.0, 0.5, abs(x) == RADIUS) * select(1.0, 0.5, abs(y) == RADIUS);
            filtered += alike * box * value;
            sum += alike * value;
            squares += alike * value * value;
            weights += alike * vec2f(box, 1.0);
        }
    }
    let mean = sum / weights.y;
    return Surroundings(filtered / weights.x, sqrt(max(squares / weights.y - mean * mean, vec4f(0.0))));
}

@compute @workgroup_size(8, 8)
fn main(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(local_invocation_id) local: vec3u,
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group: vec3u,
) {
    load_tile(8 * vec2i(group.xy) - RADIUS, thread);
    if any(id.xy >= contact.size) {
        return;
    }
    if textureLoad(gbuffer_depth, contact_pixel(id.xy), 0) == 0.0 {
        textureStore(contact_denoised, id.xy, vec4f(0.0, 0.0, 0.0, 1.0));
        textureStore(contact_frames, id.xy, vec4f(0.0));
        return;
    }
    let now = look_around(local.xy + vec2u(u32(RADIUS)));
    let past = textureLoad(contact_moved, id.xy, 0);
    let frames = min(textureLoad(contact_sources, id.xy, 0).w, contact.history_frames - 1.0);
    let width = contact.clip_width * now.deviation;
    let clipped = clamp(past, now.mean - width, now.mean + width);
    textureStore(contact_denoised, id.xy, mix(clipped, now.mean, 1.0 / (frames + 1.0)));
    textureStore(contact_frames, id.xy, vec4f(frames + 1.0));
}
