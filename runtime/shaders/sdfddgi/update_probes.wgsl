// Updates the irradiance of every probe (SDFDDGI, section 3.3): one workgroup a probe, one thread a ray, then one
// thread a texel of the octahedral map. Rays go in low-discrepancy directions, turned at random each frame; what shines
// and is small is drawn besides.

import package::lib::brdf::{brdf_lambert};
import package::lib::lights::{direct_radiance_at_hit};
import package::lib::octahedral::{oct_texel_direction};
import package::lib::quaternion::{quat_rotate};
import package::lib::random::{PI, random_hash, random_rotation, random_uniform, spherical_fibonacci};
import package::lib::sky::{sky_radiance_within};
import package::probes::emitters::{emission_is_drawn, probe_emission};
import package::probes::grid::{probe_count};
import package::probes::maps::{IRRADIANCE_SIZE};
import package::probes::states::{probe_is_placed};
import package::sdfddgi::lookup::{gi_irradiance_of_one, probe_records};
import package::structs::{ProbeHistory, UpdateSettings};
import package::tracer::sights::{sight_along};

@group(0) @binding(0) var<uniform> settings: UpdateSettings;
@group(0) @binding(1) var<storage, read_write> histories: array<ProbeHistory>;
@group(0) @binding(2) var<storage, read_write> exact_irradiance: array<vec4f>;

const THREADS: u32 = IRRADIANCE_SIZE * IRRADIANCE_SIZE;

// Irradiance below this is darkness: a moonless night has a thousand times more.
const DARKNESS: f32 = 1e-9;

// Drift of the light is looked for in the mean of about so many frames, against a spread over so many.
const DRIFT_BLEND: f32 = 1.0 / 16.0;
const SPREAD_BLEND: f32 = 1.0 / 48.0;

// Squared ratio of drift to spread above which the light is taken to change (noise alone: about 0.03), and is sure to.
const DRIFT_LEAST: f32 = 0.4;
const DRIFT_SURE: f32 = 0.8;

// Blend of a probe whose light is sure to drift.
const DRIFT_CATCH_UP: f32 = 0.5;

// A light that has gone out to this share of the brightest in about so many frames is not worth a mean any more.
const FADED: f32 = 1e-3;
const PEAK_BLEND: f32 = 1.0 / 256.0;

// Parts the random numbers of draws from those of rays.
const DRAW_KEY: u32 = 0x9e3779b9u;

var<workgroup> ray_direction: array<vec3f, THREADS>;
var<workgroup> ray_radiance: array<vec3f, THREADS>;

// Light that arrives at a probe along a ray: sky, or what the hit reflects of direct light and of the last frame's probes,
// and what it emits where draws do not count that.
fn incoming_radiance(origin: vec3f, direction: vec3f, reach: f32, solid_angle: f32, u: f32) -> vec3f {
    let seen = sight_along(origin, direction, reach);
    if !seen.is_hit {
        return sky_radiance_within(direction, solid_angle);
    }
    var total = direct_radiance_at_hit(seen.position, seen.normal, seen.albedo, seen.half_thickness);
    if !emission_is_drawn(seen) {
        total += seen.emission;
    }
    if settings.bounce > 0.0 {
        let arriving = gi_irradiance_of_one(seen.position, seen.normal, u);
        total += settings.bounce * brdf_lambert(seen.albedo, arriving);
    }
    return total;
}

// The history after a frame that measured `fluence`. The new frame's share in the blend is 1 / frames: a running mean
// over more and more frames, cut short when the light drifts away from it.
fn advance(history: ProbeHistory, fluence: f32) -> ProbeHistory {
    var next = history;
    if history.frames == 0.0 || settings.forget_drift != 0u {
        next.drift = 0.0;
        next.spread = 0.0;
        next.age = 0.0;
    }
    let change = select(fluence - history.fluence, 0.0, history.frames == 0.0);
    next.age = min(next.age + 1.0, 4096.0);
    next.drift = mix(next.drift, change, DRIFT_BLEND);
    next.spread = mix(next.spread, change * change, SPREAD_BLEND);
    let seen_spread = next.spread / (1.0 - pow(1.0 - SPREAD_BLEND, next.age));
    let certainty = select(0.0, next.drift * next.drift / seen_spread, seen_spread > 0.0);
    let catch_up = DRIFT_CATCH_UP * smoothstep(DRIFT_LEAST, DRIFT_SURE, certainty);
    next.frames = min(history.frames + 1.0, settings.most_frames);
    next.frames = min(next.frames, 1.0 / max(catch_up, 1e-6));
    next.peak = max(history.peak * (1.0 - PEAK_BLEND), history.fluence);
    if history.fluence < FADED * next.peak {
        next.frames = 1.0;
    }
    next.fluence = mix(history.fluence, fluence, 1.0 / next.frames);
    return next;
}

@compute @workgroup_size(8, 8)
fn main(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_id) texel: vec3u,
    @builtin(local_invocation_index) thread: u32,
) {
    let probe = group.x + group.y * groups.x;
    let position = probe_records[min(probe, probe_count())].position;
    if probe > probe_count() || !probe_is_placed(position.w) {
        return;
    }
    // The last one sees the sky alone: its rays end where they start.
    let reach = select(settings.reach, 0.0, probe == probe_count());
    let history = histories[probe];
    let batches = settings.batches * select(1u, settings.fresh_factor, history.frames == 0.0);
    let rays = batches * THREADS;
    let rotation = random_rotation(random_uniform(random_hash(vec3u(probe, settings.frame, settings.seed))));
    let normal = oct_texel_direction(texel.xy, IRRADIANCE_SIZE);
    var gathered = vec3f(0.0);
    var cosines = 0.0;
    var total = vec3f(0.0);
    for (var batch = 0u; batch < batches; batch++) {
        let ray = thread * batches + batch;
        let direction = quat_rotate(rotation, spherical_fibonacci(ray, rays));
        let key = settings.seed ^ ((ray + 1u) * 2654435761u);
        let u = random_uniform(random_hash(vec3u(probe, settings.frame, key))).x;
        ray_direction[thread] = direction;
        ray_radiance[thread] = incoming_radiance(position.xyz, direction, reach, 4.0 * PI / f32(rays), u);
        workgroupBarrier();
        for (var i = 0u; i < THREADS; i++) {
            let cosine = max(dot(normal, ray_direction[i]), 0.0);
            gathered += cosine * ray_radiance[i];
            cosines += cosine;
            total += ray_radiance[i];
        }
        workgroupBarrier();
    }
    let turn = random_uniform(random_hash(vec3u(probe, settings.frame, settings.seed ^ DRAW_KEY)));
    let drawn = probe_emission(position.xyz, normal, thread, reach, turn);
    let next = advance(history, dot(total / f32(rays) + drawn.radiance, vec3f(0.2126, 0.7152, 0.0722)));
    let measured = gathered * (PI / cosines) + drawn.irradiance;
    let place = probe * THREADS + thread;
    let before = select(exact_irradiance[place].rgb, vec3f(0.0), history.frames == 0.0);
    let blended = mix(before, measured, 1.0 / next.frames);
    exact_irradiance[place] = vec4f(select(blended, vec3f(0.0), blended < vec3f(DARKNESS)), 1.0);
    if thread == 0u {
        histories[probe] = next;
    }
}
