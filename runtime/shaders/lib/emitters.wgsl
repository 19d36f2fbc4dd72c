// The surfaces that shine, in the order of their shares of all power: whichever the tracer, in its group.

import package::lib::sight::{Sight};
import package::structs::{Emitter};

@group(1) @binding(7) var<storage, read> emitters: array<Emitter>;

// A point to look at, drawn by the power of surfaces and evenly on each.
struct EmitterPoint {
    position: vec3f,
    normal: vec3f,
    // The primitive or triangle that it lies on.
    surface: u32,
    // Whether the origin is on a side of it that shines.
    is_facing: bool,
}

// The first of `count` emitters whose share, summed up, is above u in [0, 1).
fn emitter_drawn(u: f32, count: u32) -> Emitter {
    var first = 0u;
    var end = count - 1u;
    while first < end {
        let middle = (first + end) / 2u;
        if emitters[middle].share > u {
            end = middle;
        } else {
            first = middle + 1u;
        }
    }
    return emitters[first];
}

// Density, 1/sr, of points that are drawn with `share`, 1/m2, on a surface at distance t whose normal turns from the ray
// by an angle of this cosine.
fn emitter_density(share: f32, t: f32, cosine: f32) -> f32 {
    return share * t * t / max(cosine, 1e-6);
}

// That with which draws from a ray's origin go where the ray does.
fn emitter_density_along(seen: Sight) -> f32 {
    return emitter_density(seen.drawn_share, seen.t, seen.face_cosine);
}
