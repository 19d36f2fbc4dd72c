// Exact signed distances in a primitive's local space, negative inside, and their unit gradients.
// Twin: runtime/twins/sdf.py (which is fit/sdf.py); the conventions for ties are told there.

fn sd_box(p: vec3f, half: vec3f) -> f32 {
    let q = abs(p) - half;
    return length(max(q, vec3f(0.0))) + min(max(q.x, max(q.y, q.z)), 0.0);
}

fn sd_sphere(p: vec3f, radius: f32) -> f32 {
    return length(p) - radius;
}

fn sd_cylinder(p: vec3f, radius: f32, half_height: f32) -> f32 {
    let q = vec2f(length(p.xz) - radius, abs(p.y) - half_height);
    return length(max(q, vec2f(0.0))) + min(max(q.x, q.y), 0.0);
}

fn sd_half_space(p: vec3f) -> f32 {
    return p.y;
}

fn sd_box_gradient(p: vec3f, half: vec3f) -> vec3f {
    let q = abs(p) - half;
    let facing = select(vec3f(1.0), vec3f(-1.0), p < vec3f(0.0));
    if any(q > vec3f(0.0)) {
        return facing * normalize(max(q, vec3f(0.0)));
    }
    if q.x >= max(q.y, q.z) {
        return vec3f(facing.x, 0.0, 0.0);
    }
    return select(vec3f(0.0, 0.0, facing.z), vec3f(0.0, facing.y, 0.0), q.y >= q.z);
}

fn sd_sphere_gradient(p: vec3f, radius: f32) -> vec3f {
    let l = length(p);
    return select(vec3f(1.0, 0.0, 0.0), p / l, l > 0.0);
}

fn sd_cylinder_gradient(p: vec3f, radius: f32, half_height: f32) -> vec3f {
    let r = length(p.xz);
    let across = select(vec3f(1.0, 0.0, 0.0), vec3f(p.x, 0.0, p.z) / r, r > 0.0);
    let along = vec3f(0.0, select(1.0, -1.0, p.y < 0.0), 0.0);
    let q = vec2f(r - radius, abs(p.y) - half_height);
    if max(q.x, q.y) > 0.0 {
        let outward = normalize(max(q, vec2f(0.0)));
        return outward.x * across + outward.y * along;
    }
    return select(along, across, q.x >= q.y);
}

fn sd_half_space_gradient(p: vec3f) -> vec3f {
    return vec3f(0.0, 1.0, 0.0);
}
