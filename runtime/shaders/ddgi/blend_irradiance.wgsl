// Blends the light of this frame's rays into the irradiance of each direction (Majercik et al. 2019, section 4.1; change
// detection: Majercik et al. 2021, section 4), and writes the map that lookups filter. Irradiance is kept as its
// gamma-th root, in which a blend looks even and a lamp that went out is gone soon.

import package::ddgi::states::{PROBE_FRESH, PROBE_ON, ddgi_kept};
import package::lib::octahedral::{oct_texel_direction, oct_tile_corner, oct_tile_source};
import package::lib::quaternion::{quat_rotate};
import package::lib::random::{PI, spherical_fibonacci};
import package::probes::maps::{IRRADIANCE_SIZE, IRRADIANCE_TILE};
import package::structs::{DdgiUpdate};

@group(0) @binding(0) var<uniform> settings: DdgiUpdate;
@group(0) @binding(1) var<storage, read_write> states: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> histories: array<u32>;
@group(0) @binding(3) var<storage, read> probe_rays: array<vec4f>;
@group(0) @binding(4) var<storage, read> drawn_irradiance: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> encoded: array<vec4f>;
@group(0) @binding(6) var atlas: texture_storage_2d<rgba16float, write>;

const THREADS: u32 = IRRADIANCE_SIZE * IRRADIANCE_SIZE;

// Irradiance below this is darkness: a moonless night has a thousand times more.
const DARKNESS: f32 = 1e-9;

var<workgroup> direction_of: array<vec3f, THREADS>;
var<workgroup> radiance_of: array<vec3f, THREADS>;
var<workgroup> map: array<vec3f, THREADS>;

// Share of the old value that is kept: less where it changed clearly, nothing where it changed altogether.
fn kept_share(before: vec3f, after: vec3f, most: f32) -> f32 {
    let largest = max(max(max(before.r, before.g), before.b), max(max(after.r, after.g), after.b));
    let difference = abs(after - before);
    let change = max(max(difference.r, difference.g), difference.b) / max(largest, 1e-20);
    if change > settings.change_altogether {
        return 0.0;
    }
    return max(most - select(0.0, settings.hysteresis_drop, change > settings.change_clear), 0.0);
}

@compute @workgroup_size(8, 8)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_id) texel: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let traced = min(group.x + group.y * groups.x, settings.probe_count - 1u);
    let probe = settings.first_probe + traced;
    let is_off = states[probe].w < PROBE_FRESH || group.x + group.y * groups.x >= settings.probe_count;
    let normal = oct_texel_direction(texel.xy, IRRADIANCE_SIZE);
    var gathered = vec3f(0.0);
    var cosines = 0.0;
    for (var first = 0u; first < settings.rays; first += THREADS) {
        let ray = first + thread;
        direction_of[thread] = quat_rotate(settings.rotation, spherical_fibonacci(ray, settings.rays));
        radiance_of[thread] = probe_rays[traced * settings.rays + ray].rgb;
        workgroupBarrier();
        for (var i = 0u; i < THREADS; i++) {
            let cosine = max(dot(normal, direction_of[i]), 0.0);
            gathered += cosine * radiance_of[i];
            cosines += cosine;
        }
        workgroupBarrier();
    }
    let place = probe * THREADS + thread;
    let drawn = drawn_irradiance[traced * THREADS + thread].rgb;
    let irradiance = gathered * (PI / max(cosines, 1e-9)) + drawn;
    let after = pow(select(irradiance, vec3f(0.0), irradiance < vec3f(DARKNESS)), vec3f(1.0 / settings.gamma));
    let before = encoded[place].rgb;
    let history = histories[probe];
    let most = ddgi_kept(history, settings.hysteresis, settings.settling_growth);
    let blended = mix(after, before, kept_share(before, after, most));
    let smallest = vec3f(pow(DARKNESS, 1.0 / settings.gamma));
    map[thread] = select(blended, vec3f(0.0), blended < smallest);
    workgroupBarrier();
    if is_off {
        return;
    }
    encoded[place] = vec4f(map[thread], 1.0);
    let corner = oct_tile_corner(probe, settings.columns, IRRADIANCE_SIZE);
    for (var i = thread; i < IRRADIANCE_TILE * IRRADIANCE_TILE; i += THREADS) {
        let tile = vec2u(i % IRRADIANCE_TILE, i / IRRADIANCE_TILE);
        let source = oct_tile_source(tile, IRRADIANCE_SIZE);
        textureStore(atlas, corner + tile, vec4f(map[source.x + IRRADIANCE_SIZE * source.y], 1.0));
    }
    if thread == 0u {
        histories[probe] = min(history + 1u, 65535u);
        states[probe].w = PROBE_ON;
    }
}
