// Blends the distances of this frame's rays into the mean and mean square of each direction (Majercik et al. 2019,
// section 4.1), by a cosine to a high power, and writes the map that lookups filter.

import package::ddgi::states::{PROBE_FRESH, ddgi_kept};
import package::lib::octahedral::{oct_texel_direction, oct_tile_corner, oct_tile_source};
import package::lib::quaternion::{quat_rotate};
import package::lib::random::{spherical_fibonacci};
import package::probes::maps::{DISTANCE_SIZE, DISTANCE_TILE};
import package::structs::{DdgiUpdate};

@group(0) @binding(0) var<uniform> settings: DdgiUpdate;
@group(0) @binding(1) var<storage, read> states: array<vec4f>;
@group(0) @binding(2) var<storage, read> histories: array<u32>;
@group(0) @binding(3) var<storage, read> probe_rays: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> moments: array<vec2f>;
@group(0) @binding(5) var atlas: texture_storage_2d<rgba16float, write>;

const THREADS: u32 = DISTANCE_SIZE * DISTANCE_SIZE;
const SMALLEST_WEIGHT: f32 = 1e-9;

var<workgroup> direction_of: array<vec3f, THREADS>;
var<workgroup> distance_of: array<f32, THREADS>;
var<workgroup> map: array<vec2f, THREADS>;

@compute @workgroup_size(16, 16)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_id) texel: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let traced = min(group.x + group.y * groups.x, settings.probe_count - 1u);
    let probe = settings.first_probe + traced;
    let is_off = states[probe].w < PROBE_FRESH || group.x + group.y * groups.x >= settings.probe_count;
    let normal = oct_texel_direction(texel.xy, DISTANCE_SIZE);
    var sums = vec2f(0.0);
    var weights = 0.0;
    for (var first = 0u; first < settings.rays; first += THREADS) {
        let ray = first + thread;
        if ray < settings.rays {
            direction_of[thread] = quat_rotate(settings.rotation, spherical_fibonacci(ray, settings.rays));
            distance_of[thread] = min(probe_rays[traced * settings.rays + ray].w / settings.farthest, 1.0);
        }
        workgroupBarrier();
        for (var i = 0u; i < min(THREADS, settings.rays - first); i++) {
            let weight = pow(max(dot(normal, direction_of[i]), 0.0), settings.distance_exponent);
            sums += weight * vec2f(distance_of[i], distance_of[i] * distance_of[i]);
            weights += weight;
        }
        workgroupBarrier();
    }
    let place = probe * THREADS + thread;
    let before = moments[place];
    let keep = ddgi_kept(histories[probe], settings.hysteresis, settings.settling_growth);
    let blended = select(before, mix(sums / max(weights, SMALLEST_WEIGHT), before, keep), weights > SMALLEST_WEIGHT);
    map[thread] = blended;
    workgroupBarrier();
    if is_off {
        return;
    }
    moments[place] = blended;
    let corner = oct_tile_corner(probe, settings.columns, DISTANCE_SIZE);
    for (var i = thread; i < DISTANCE_TILE * DISTANCE_TILE; i += THREADS) {
        let tile = vec2u(i % DISTANCE_TILE, i / DISTANCE_TILE);
        let source = oct_tile_source(tile, DISTANCE_SIZE);
        textureStore(atlas, corner + tile, vec4f(map[source.x + DISTANCE_SIZE * source.y], 0.0, 1.0));
    }
}
