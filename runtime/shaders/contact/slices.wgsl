// A slice of the screen through a pixel, and the surfaces that a walk along it meets (Jimenez et al. 2016, section 4).
// All in view space.

import package::contact::info::{
    contact, contact_distance, contact_pixel, contact_place, contact_towards_viewer, contact_view_direction,
    contact_view_position,
};
import package::lib::frame::{frame};
import package::lib::horizon::{horizon_slice};
import package::lib::random::{PI};
import package::primary::gbuffer::{gbuffer_depth, gbuffer_face_normal, gbuffer_normal};

// Depth at another place of a texel's plane is trusted within this share of its own: beyond, the plane is seen edge-on.
const PLANE_TRUST: f32 = 0.05;

// The point from which the walks begin.
struct SliceCentre {
    place: vec2f,
    position: vec3f,
    normal: vec3f,
    towards_viewer: vec3f,
}

// across: unit, at a right angle to the way to the viewer. tilt: of the projected normal. weight: share of the
// hemisphere's light in this slice, over all slices 1 on average. direction: across, on the screen. metre: its length in
// pixels.
struct Slice {
    across: vec3f,
    tilt: f32,
    weight: f32,
    direction: vec2f,
    metre: f32,
}

// What a step of the walk met, if anything. way: from the centre, metres.
struct Met {
    is_surface: bool,
    texel: vec2u,
    way: vec3f,
    normal: vec3f,
    towards_viewer: vec3f,
}

fn slice_centre(pixel: vec2u) -> SliceCentre {
    let place = vec2f(pixel) + 0.5;
    let position = contact_view_position(place, contact_distance(textureLoad(gbuffer_depth, pixel, 0)));
    let normal = contact_view_direction(gbuffer_normal(pixel));
    return SliceCentre(place, position, normal, contact_towards_viewer(position));
}

// turn: 0 to 1 is half a turn about the way to the viewer, after which the sides are swapped.
fn slice_through(centre: SliceCentre, turn: f32) -> Slice {
    let v = centre.towards_viewer;
    let right = normalize(vec3f(v.z, 0.0, -v.x));
    let across = cos(PI * turn) * right + sin(PI * turn) * cross(v, right);
    let sideways = cross(v, across);
    let projected = centre.normal - sideways * dot(centre.normal, sideways);
    let tilt = atan2(dot(projected, across), dot(projected, v));
    // The derivative of the projection along `across`.
    let p = centre.position;
    let slope = select((across.xy * -p.z + p.xy * across.z) / (p.z * p.z), across.xy, frame.orthographic != 0u);
    let pixels = slope / frame.extent * vec2f(frame.size) * vec2f(0.5, -0.5);
    let metre = length(pixels);
    return Slice(across, tilt, length(projected) * horizon_slice(tilt), pixels / max(metre, 1e-20), metre);
}

// Length of a slice in pixels: the radius, and at most the longest walk.
fn slice_reach(slice: Slice) -> f32 {
    return min(contact.radius * slice.metre, contact.longest);
}

// How far from the centre a step is, in pixels; share: of the walk, in [0, 1).
fn slice_step(reach: f32, share: f32) -> f32 {
    let nearest = f32(contact.scale);
    return nearest + (reach - nearest) * pow(share, contact.step_exponent);
}

// Weight of what is met at a distance in metres, for a slice of a length in pixels: it fades out towards the end.
fn slice_falloff(slice: Slice, reach: f32, distance: f32) -> f32 {
    return clamp((1.0 - distance * slice.metre / reach) / contact.falloff, 0.0, 1.0);
}

fn is_on_screen(place: vec2f) -> bool {
    return all(place >= vec2f(0.0)) && all(place < vec2f(frame.size));
}

// The surface at a place of the picture. A texel stands for its middle only: at the place itself its plane is met, so
// that a flat wall never seems to rise above itself, at any angle and resolution.
fn slice_meet(centre: SliceCentre, place: vec2f) -> Met {
    let texel = min(vec2u(max(round(contact_place(place)), vec2f(0.0))), contact.size - 1u);
    let pixel = contact_pixel(texel);
    let depth = textureLoad(gbuffer_depth, pixel, 0);
    if depth == 0.0 || all(vec2f(pixel) + 0.5 == centre.place) {
        return Met(false, texel, vec3f(0.0), vec3f(0.0), vec3f(0.0));
    }
    let stored = contact_distance(depth);
    let middle = contact_view_position(vec2f(pixel) + 0.5, stored);
    let normal = contact_view_direction(gbuffer_face_normal(pixel));
    let near = contact_view_position(place, 0.0);
    let ray = contact_view_position(place, 1.0) - near;
    let along = dot(normal, ray);
    let crossed = dot(normal, middle - near) / select(along, 1e-6, abs(along) < 1e-6);
    let distance = clamp(crossed, stored * (1.0 - PLANE_TRUST), stored * (1.0 + PLANE_TRUST));
    let position = near + ray * distance;
    return Met(true, texel, position - centre.position, normal, contact_towards_viewer(position));
}
