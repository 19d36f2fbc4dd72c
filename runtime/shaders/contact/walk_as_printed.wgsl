// Contact GI as SDFDDGI prints it (section 3.5, eq. 5, Fig. 10): while the walk looks for the horizon of ground-truth
// ambient occlusion, every surface that rises above it adds E_i = C_i sqrt(1 - (n_c . n_i)^2) A_i / distance^2.
// Surfaces are endlessly thick. What a step stands for, A_i, is its part of the ring between it and the next step.

import package::contact::info::{contact, contact_pixel};
import package::contact::noise::{contact_noise};
import package::contact::slices::{
    Met, Slice, SliceCentre, is_on_screen, slice_centre, slice_falloff, slice_meet, slice_reach, slice_step,
    slice_through,
};
import package::lib::frame::{frame};
import package::lib::half::{HALF_BOUND};
import package::lib::horizon::{HORIZON_HALF_PI, horizon_share};
import package::lib::random::{PI};
import package::primary::gbuffer::{gbuffer_depth};

@group(0) @binding(9) var contact_sources: texture_2d<f32>;
@group(0) @binding(10) var contact_gathered: texture_storage_2d<rgba16float, write>;

// Area of a surface that one pixel shows, square metres.
fn pixel_area(met: Met, position: vec3f) -> f32 {
    let depth = select(-position.z, 1.0, frame.orthographic != 0u);
    let side = 2.0 * frame.extent * depth / vec2f(frame.size);
    return side.x * side.y / max(dot(met.normal, met.towards_viewer), 0.05);
}

// Irradiance of one slice, and in w the share of it that is open.
fn walk_slice(centre: SliceCentre, slice: Slice, jitter: f32) -> vec4f {
    let reach = slice_reach(slice);
    var irradiance = vec3f(0.0);
    var shares = vec2f(0.0, 1.0);
    for (var side = -1.0; side < 2.0; side += 2.0) {
        var horizon = slice.tilt + side * HORIZON_HALF_PI;
        var before = f32(contact.scale);
        for (var i = 0u; i < contact.steps; i++) {
            let step = slice_step(reach, (f32(i) + jitter) / f32(contact.steps));
            let place = centre.place + side * step * slice.direction;
            if step > reach || !is_on_screen(place) {
                break;
            }
            let met = slice_meet(centre, place);
            let distance = length(met.way);
            let weight = slice_falloff(slice, reach, distance);
            let angle = atan2(dot(met.way, slice.across), dot(met.way, centre.towards_viewer));
            let ring = step * (step - before) * PI / f32(contact.slices);
            before = step;
            if !met.is_surface || weight == 0.0 || side * angle >= side * horizon {
                continue;
            }
            horizon = mix(horizon, angle, weight);
            if dot(met.normal, met.way) < 0.0 {
                let cosine = dot(centre.normal, met.normal);
                let area = ring * pixel_area(met, centre.position + met.way);
                let seen = sqrt(max(1.0 - cosine * cosine, 0.0)) * area / (distance * distance);
                irradiance += weight * seen * textureLoad(contact_sources, met.texel, 0).rgb;
            }
        }
        if side < 0.0 {
            shares.x = horizon_share(horizon, slice.tilt);
        } else {
            shares.y = horizon_share(horizon, slice.tilt);
        }
    }
    return vec4f(irradiance, slice.weight * max(shares.y - shares.x, 0.0));
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= contact.size) {
        return;
    }
    let pixel = contact_pixel(id.xy);
    var gathered = vec4f(0.0, 0.0, 0.0, 1.0);
    if textureLoad(gbuffer_depth, pixel, 0) > 0.0 {
        let centre = slice_centre(pixel);
        let noise = contact_noise(id.xy);
        var total = vec4f(0.0);
        var weights = 0.0;
        for (var i = 0u; i < contact.slices; i++) {
            let slice = slice_through(centre, (f32(i) + noise.x) / f32(contact.slices));
            total += walk_slice(centre, slice, noise.y);
            weights += slice.weight;
        }
        // Each slice has its own part of the ring already; openness is a mean over slices, around an open one's 1.
        gathered = vec4f(min(total.rgb, vec3f(HALF_BOUND)), 1.0 - (weights - total.w) / f32(contact.slices));
    }
    textureStore(contact_gathered, id.xy, gathered);
}
