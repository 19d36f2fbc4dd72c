// The near field of every texel: how much of its hemisphere the surfaces on the screen within the radius cover, and the
// irradiance that they send there instead. Slices as in ground-truth ambient occlusion (Jimenez et al. 2016); a slice's
// light is divided into 32 equal sectors, and a sector counts once, for the first surface that covers it. So what is
// covered and what is left to the probes always make one: energy is neither made nor lost.

import package::contact::info::{contact, contact_pixel};
import package::contact::noise::{contact_noise};
import package::contact::slices::{
    Met, Slice, SliceCentre, is_on_screen, slice_centre, slice_falloff, slice_meet, slice_reach, slice_step,
    slice_through,
};
import package::lib::brdf::{brdf_lambert};
import package::lib::horizon::{HORIZON_SECTORS, horizon_sectors, horizon_share};
import package::lib::random::{PI};
import package::primary::gbuffer::{gbuffer_albedo, gbuffer_depth, gbuffer_emission};

@group(0) @binding(9) var probe_irradiance: texture_2d<f32>;
@group(0) @binding(10) var contact_sources: texture_2d<f32>;

// Irradiance from what is near, and the share of the hemisphere that is open.
@group(0) @binding(11) var contact_gathered: texture_storage_2d<rgba16float, write>;

// Radiance that a surface sends to the centre. The viewer sees the lit side alone: a side that is turned away is taken
// to be lit as the centre is by the probes.
fn sent_radiance(met: Met, ambient: vec3f) -> vec3f {
    if dot(met.normal, met.way) < 0.0 {
        return textureLoad(contact_sources, met.texel, 0).rgb;
    }
    let pixel = contact_pixel(met.texel);
    let albedo = textureLoad(gbuffer_albedo, pixel, 0).rgb;
    return brdf_lambert(albedo, ambient) + textureLoad(gbuffer_emission, pixel, 0).rgb;
}

// The sectors of a slice that a surface covers: from its visible point to what lies `thickness` metres behind it.
fn covered_sectors(centre: SliceCentre, slice: Slice, met: Met, jitter: f32) -> u32 {
    let behind = met.way - contact.thickness * met.towards_viewer;
    let front = atan2(dot(met.way, slice.across), dot(met.way, centre.towards_viewer));
    let back = atan2(dot(behind, slice.across), dot(behind, centre.towards_viewer));
    let from_share = horizon_share(front, slice.tilt);
    // A way that turns past straight down comes out on the other side: it ends at the tangent.
    let to_share = select(horizon_share(back, slice.tilt), select(1.0, 0.0, front < 0.0), front * back < 0.0);
    return horizon_sectors(min(from_share, to_share), max(from_share, to_share), jitter);
}

// Mean radiance of the covered sectors times their share, and that share in w, of one slice.
fn walk_slice(centre: SliceCentre, slice: Slice, noise: vec2f, ambient: vec3f) -> vec4f {
    let reach = slice_reach(slice);
    var total = vec4f(0.0);
    var covered = 0u;
    for (var side = -1.0; side < 2.0; side += 2.0) {
        for (var i = 0u; i < contact.steps; i++) {
            let step = slice_step(reach, (f32(i) + noise.x) / f32(contact.steps));
            let place = centre.place + side * step * slice.direction;
            if step > reach || !is_on_screen(place) {
                break;
            }
            let met = slice_meet(centre, place);
            let weight = slice_falloff(slice, reach, length(met.way));
            if !met.is_surface || weight == 0.0 {
                continue;
            }
            let sectors = covered_sectors(centre, slice, met, noise.y) & ~covered;
            if sectors == 0u {
                continue;
            }
            covered |= sectors;
            let share = weight * f32(countOneBits(sectors)) / HORIZON_SECTORS;
            total += share * vec4f(sent_radiance(met, ambient), 1.0);
        }
    }
    return total;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= contact.size) {
        return;
    }
    let pixel = contact_pixel(id.xy);
    var near = vec4f(0.0);
    if textureLoad(gbuffer_depth, pixel, 0) > 0.0 {
        let centre = slice_centre(pixel);
        let ambient = textureLoad(probe_irradiance, pixel, 0).rgb;
        let noise = contact_noise(id.xy);
        for (var i = 0u; i < contact.slices; i++) {
            let slice = slice_through(centre, (f32(i) + noise.x) / f32(contact.slices));
            near += slice.weight * walk_slice(centre, slice, noise.yz, ambient);
        }
        near /= f32(contact.slices);
    }
    // Not clamped: the slices' weights are 1 on average only, and so is the sum of both parts.
    textureStore(contact_gathered, id.xy, vec4f(PI * near.rgb, 1.0 - near.w));
}
