// Updates the irradiance of the chosen probes (SDFDDGI, section 3.3): one workgroup a probe, one thread a ray, then one
// thread a texel of the octahedral map. Rays go in low-discrepancy directions, turned at random each frame; what shines
// and is small is drawn besides. Further bounces change slowly over directions: some of the rays are enough for them.

import package::lib::brdf::{brdf_lambert};
import package::lib::lights::{direct_radiance_at_hit, lights_rsm_asked, lights_rsm_missed, lights_rsm_refused};
import package::lib::octahedral::{oct_texel_direction};
import package::lib::quaternion::{quat_rotate};
import package::lib::random::{PI, random_rotation, random_sequence, random_uniform, spherical_fibonacci};
import package::lib::sky::{sky_radiance_within};
import package::probes::emitters::{emission_is_drawn, probe_emission};
import package::probes::grid::{probe_count};
import package::probes::maps::{IRRADIANCE_SIZE};
import package::probes::states::{probe_is_placed};
import package::sdfddgi::lookup::{gi_irradiance_of_one, probe_records};
import package::structs::{ChoiceCounts, ProbeHistory, UpdateSettings};
import package::tracer::sights::{sight_along};

@group(0) @binding(0) var<uniform> settings: UpdateSettings;
@group(0) @binding(1) var<storage, read_write> histories: array<ProbeHistory>;
@group(0) @binding(2) var<storage, read_write> exact_irradiance: array<vec4f>;
@group(0) @binding(3) var<storage, read> chosen: array<u32>;
@group(0) @binding(4) var<storage, read> totals: ChoiceCounts;

const THREADS: u32 = IRRADIANCE_SIZE * IRRADIANCE_SIZE;

const LUMINANCE: vec3f = vec3f(0.2126, 0.7152, 0.0722);

// Irradiance below this is darkness: a moonless night has a thousand times more.
const DARKNESS: f32 = 1e-9;

// Drift of the light is looked for in the mean of about so many updates, against a spread over so many.
const DRIFT_BLEND: f32 = 1.0 / 16.0;
const SPREAD_BLEND: f32 = 1.0 / 48.0;

// Squared ratio of drift to spread above which the light is taken to change (noise alone: about 0.03), and is sure to.
const DRIFT_LEAST: f32 = 0.4;
const DRIFT_SURE: f32 = 0.8;

// Blend of a probe whose light is sure to drift.
const DRIFT_CATCH_UP: f32 = 0.5;

// A light that has gone out to this share of the brightest in about so many updates is not worth a mean any more.
const FADED: f32 = 1e-3;
const PEAK_BLEND: f32 = 1.0 / 256.0;

// Turn of the lattice that the rays for bounces come near to: of sixteen tried, that with the evenest sixteen rays.
const SUBSET_TURN: f32 = 0.5625;
const GOLDEN: f32 = 0.61803398874989;

// Parts the random numbers of draws from those of rays.
const DRAW_KEY: u32 = 0x9e3779b9u;

var<workgroup> ray_direction: array<vec3f, THREADS>;
var<workgroup> ray_radiance: array<vec3f, THREADS>;
var<workgroup> ray_bounced: array<vec3f, THREADS>;
var<workgroup> rsm_samples: array<atomic<u32>, 3>;

// Light along a ray: of the sky, or what the hit reflects of direct light and emits where draws do not count that; and what
// it reflects of the last frame's probes.
struct Incoming {
    radiance: vec3f,
    bounced: vec3f,
}

fn incoming_light(origin: vec3f, direction: vec3f, reach: f32, solid_angle: f32, bounces: bool, u: f32) -> Incoming {
    var light = Incoming(vec3f(0.0), vec3f(0.0));
    if reach <= 0.0 {
        light.radiance = sky_radiance_within(direction, solid_angle);
        return light;
    }
    let seen = sight_along(origin, direction, reach);
    if !seen.is_hit {
        light.radiance = sky_radiance_within(direction, solid_angle);
        return light;
    }
    light.radiance = direct_radiance_at_hit(seen.position, seen.normal, seen.albedo, seen.half_thickness);
    if !emission_is_drawn(seen) {
        light.radiance += seen.emission;
    }
    if bounces {
        light.bounced = settings.bounce * brdf_lambert(seen.albedo, gi_irradiance_of_one(seen.position, seen.normal, u));
    }
    return light;
}

// The history after an update that measured `fluence`. Its share in the blend is 1 / frames: a running mean over more and
// more updates, cut short when the light drifts away from it. Soon after a change of the world or its light it is one of
// few, counted in frames: a probe that is updated every eighth frame has no time for a mean of four.
fn advance(history: ProbeHistory, fluence: f32) -> ProbeHistory {
    var next = history;
    let waited = max(history.waited, 1.0);
    let since = f32(settings.since_change);
    let is_settling = settings.since_change < settings.settling_frames || since < waited;
    next.waited = 0.0;
    next.updates = history.updates + 1u;
    if history.frames == 0.0 || is_settling {
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
    next.frames = min(min(history.frames + 1.0, settings.history_frames), 1.0 / max(catch_up, 1e-6));
    if is_settling {
        let few = max(settings.settling_history, settings.settling_growth * since) / waited;
        next.frames = min(next.frames, max(few, 1.0));
    }
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
    let probe = chosen[min(group.x + group.y * groups.x, probe_count())];
    let position = probe_records[probe].position;
    if group.x + group.y * groups.x > probe_count() || !probe_is_placed(position.w) {
        return;
    }
    // The last one sees the sky alone.
    let reach = select(settings.reach, 0.0, probe == probe_count());
    let history = histories[probe];
    let batches = settings.batches * ray_factor(history.frames == 0.0);
    let rays = batches * THREADS;
    // By the probe's own count of updates: what the mean of its last ones saw is spread evenly over all rotations.
    let number = history.updates;
    let rotation = random_rotation(random_uniform(random_sequence(vec3u(probe, 0u, settings.seed), number)));
    let normal = oct_texel_direction(texel.xy, IRRADIANCE_SIZE);
    let bouncing = THREADS / settings.bounce_stride;
    let bounces = thread < bouncing && settings.bounce > 0.0;
    var gathered = vec3f(0.0);
    var bounced = vec3f(0.0);
    var cosines = vec2f(0.0);
    var total = vec3f(0.0);
    for (var batch = 0u; batch < batches; batch++) {
        let ray = ray_of_thread(thread, bouncing, batches, batch);
        let direction = quat_rotate(rotation, spherical_fibonacci(ray, rays));
        let u = random_uniform(random_sequence(vec3u(probe, ray + 1u, settings.seed), number)).x;
        let light = incoming_light(position.xyz, direction, reach, 4.0 * PI / f32(rays), bounces, u);
        ray_direction[thread] = direction;
        ray_radiance[thread] = light.radiance;
        ray_bounced[thread] = light.bounced;
        workgroupBarrier();
        for (var i = 0u; i < THREADS; i++) {
            let cosine = max(dot(normal, ray_direction[i]), 0.0);
            gathered += cosine * ray_radiance[i];
            bounced += cosine * ray_bounced[i];
            cosines += cosine * vec2f(1.0, select(0.0, 1.0, i < bouncing));
            total += ray_radiance[i] + ray_bounced[i] * f32(settings.bounce_stride);
        }
        workgroupBarrier();
    }
    let turn = random_uniform(random_sequence(vec3u(probe, DRAW_KEY, settings.seed), number));
    let drawn = probe_emission(position.xyz, normal, thread, reach, turn);
    var next = advance(history, dot(LUMINANCE, total / f32(rays) + drawn.radiance));
    let measured = PI * (gathered / cosines.x + bounced / max(cosines.y, 1e-9)) + drawn.irradiance;
    let place = probe * THREADS + thread;
    let before = select(exact_irradiance[place].rgb, vec3f(0.0), history.frames == 0.0);
    let blended = mix(before, measured, 1.0 / next.frames);
    exact_irradiance[place] = vec4f(select(blended, vec3f(0.0), blended < vec3f(DARKNESS)), 1.0);
    count_samples(thread);
    if thread == 0u {
        next.rsm_asked = atomicLoad(&rsm_samples[0]);
        next.rsm_refused = atomicLoad(&rsm_samples[1]);
        next.rsm_missed = atomicLoad(&rsm_samples[2]);
        histories[probe] = next;
    }
}

// The first `bouncing` threads hold rays that are spread evenly by themselves: of each few neighbours on the lattice the
// one whose azimuth is nearest to that on a lattice of so many points. Every n-th ray would not do, those of each eighth
// all look to one side.
fn ray_of_thread(thread: u32, bouncing: u32, batches: u32, batch: u32) -> u32 {
    let stride = THREADS / bouncing;
    let row = thread % bouncing;
    let azimuth = fract(f32(row) * GOLDEN + SUBSET_TURN);
    var best = 0u;
    var nearest = 1.0;
    for (var i = 0u; i < stride; i++) {
        let away = abs(fract(f32((row * stride + i) * batches + batch) * GOLDEN - azimuth + 0.5) - 0.5);
        if away < nearest {
            best = i;
            nearest = away;
        }
    }
    return (row * stride + (best + thread / bouncing) % stride) * batches + batch;
}

// How many times as many rays as others a probe takes. Where many have no light yet, they share what a budget's worth of
// others takes.
fn ray_factor(is_fresh: bool) -> u32 {
    let affordable = settings.budget / max(totals.fresh, 1u);
    return select(1u, clamp(affordable, 1u, settings.fresh_factor), is_fresh);
}

// Samples of reflective shadow maps that were asked for, refused and missed, over the workgroup.
fn count_samples(thread: u32) {
    if thread < 3u {
        atomicStore(&rsm_samples[thread], 0u);
    }
    workgroupBarrier();
    atomicAdd(&rsm_samples[0], lights_rsm_asked);
    atomicAdd(&rsm_samples[1], lights_rsm_refused);
    atomicAdd(&rsm_samples[2], lights_rsm_missed);
    workgroupBarrier();
}
