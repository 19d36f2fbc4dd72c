// Writes the irradiance of the chosen probes as lookups read it: its linear part (constant + slope . normal) in the record,
// the rest in the atlas that lookups filter, in half floats relative to the largest, with the border that carries
// bilinear filtering across the octahedral seams.
//
// Bilinear filtering of 8 x 8 texels alone is wrong by up to 6 % of the linear part between texels, which is most of
// what irradiance has; taken out first, that part is exact.

import package::lib::octahedral::{oct_texel_direction, oct_tile_corner, oct_tile_source};
import package::probes::grid::{probe_count, probe_grid};
import package::probes::maps::{IRRADIANCE_SIZE, IRRADIANCE_TILE};
import package::probes::states::{probe_is_placed};
import package::structs::{ProbeRecord};

@group(0) @binding(0) var<storage, read> exact_irradiance: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> records: array<ProbeRecord>;
@group(0) @binding(2) var atlas: texture_storage_2d<rgba16float, write>;
@group(0) @binding(3) var<storage, read> chosen: array<u32>;

const THREADS: u32 = IRRADIANCE_SIZE * IRRADIANCE_SIZE;

// Sums of x^2, y^2 and z^2 over the directions of the map's texels, whose mixed sums are 0.
const TEXEL_SQUARES: vec3f = vec3f(21.493510, 21.493510, 21.012980);

var<workgroup> map: array<vec3f, THREADS>;
var<workgroup> linear_part: array<vec4f, 3>;

// Least-squares fit of constant + slope . direction to one channel of the map.
fn fit_linear(channel: u32) -> vec4f {
    var fitted = vec4f(0.0);
    for (var i = 0u; i < THREADS; i++) {
        let direction = oct_texel_direction(vec2u(i % IRRADIANCE_SIZE, i / IRRADIANCE_SIZE), IRRADIANCE_SIZE);
        fitted += map[i][channel] * vec4f(1.0, direction);
    }
    return fitted / vec4f(f32(THREADS), TEXEL_SQUARES);
}

fn linear_irradiance(direction: vec3f) -> vec3f {
    let h = vec4f(1.0, direction);
    return vec3f(dot(linear_part[0], h), dot(linear_part[1], h), dot(linear_part[2], h));
}

@compute @workgroup_size(8, 8)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_id) texel: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let probe = chosen[min(group.x + group.y * groups.x, probe_count())];
    if group.x + group.y * groups.x > probe_count() || !probe_is_placed(records[probe].position.w) {
        return;
    }
    map[thread] = exact_irradiance[probe * THREADS + thread].rgb;
    workgroupBarrier();
    if thread < 3u {
        linear_part[thread] = fit_linear(thread);
    }
    workgroupBarrier();
    let rest = map[thread] - linear_irradiance(oct_texel_direction(texel.xy, IRRADIANCE_SIZE));
    workgroupBarrier();
    map[thread] = rest;
    workgroupBarrier();
    var largest = vec3f(0.0);
    for (var i = 0u; i < THREADS; i++) {
        largest = max(largest, abs(map[i]));
    }
    let scale = max(largest.x, max(largest.y, largest.z));
    let inverse = select(0.0, 1.0 / scale, scale > 0.0);
    let corner = oct_tile_corner(probe, probe_grid.columns, IRRADIANCE_SIZE);
    for (var i = thread; i < IRRADIANCE_TILE * IRRADIANCE_TILE; i += THREADS) {
        let place = vec2u(i % IRRADIANCE_TILE, i / IRRADIANCE_TILE);
        let source = oct_tile_source(place, IRRADIANCE_SIZE);
        let value = map[source.x + IRRADIANCE_SIZE * source.y] * inverse;
        textureStore(atlas, corner + place, vec4f(value, 1.0));
    }
    if thread == 0u {
        let position = vec4f(records[probe].position.xyz, scale);
        records[probe] = ProbeRecord(position, linear_part[0], linear_part[1], linear_part[2]);
    }
}
