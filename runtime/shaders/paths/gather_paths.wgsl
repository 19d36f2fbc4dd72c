// Irradiance at given points by path tracing (Kajiya 1986): cosine-weighted rays, direct light of every lamp at every
// bounce, unlimited bounces ended by Russian roulette. Adds its samples to those of the dispatches before.

import package::lib::brdf::{brdf_lambert};
import package::lib::random::{PI, random_hash, random_uniform};
import package::lib::sky::{sky_radiance};
import package::paths::lamps::{lamps_irradiance};
import package::structs::{PathSettings};
import package::tracer::sights::{sight_along, sight_start};

@group(0) @binding(0) var<uniform> settings: PathSettings;

// Position and normal of each point.
@group(0) @binding(1) var<storage, read> points: array<vec4f>;

// Sum of the samples and, in w, of the squares of their means over the channels.
@group(0) @binding(2) var<storage, read_write> sums: array<vec4f>;

// From this bounce on a path goes on by chance, and never beyond the last one: of that, at an albedo of 0.9, 0.1 %
// would be left.
const ROULETTE_BOUNCE: u32 = 6u;
const LAST_BOUNCE: u32 = 64u;

const FARTHEST: f32 = 1e30;

fn cosine_direction(normal: vec3f, u: vec2f) -> vec3f {
    let angle = 2.0 * PI * u.x;
    let radius = sqrt(u.y);
    // An orthonormal basis without branches (Duff et al. 2017).
    let s = select(-1.0, 1.0, normal.z >= 0.0);
    let a = -1.0 / (s + normal.z);
    let b = normal.x * normal.y * a;
    let tangent = vec3f(1.0 + s * normal.x * normal.x * a, s * b, -s * normal.x);
    let bitangent = vec3f(b, s + normal.y * normal.y * a, -normal.y);
    let height = sqrt(max(1.0 - u.y, 0.0));
    return normalize(tangent * (radius * cos(angle)) + bitangent * (radius * sin(angle)) + normal * height);
}

fn path_radiance(from_point: vec3f, along: vec3f, key: u32) -> vec3f {
    var origin = from_point;
    var direction = along;
    var throughput = vec3f(1.0);
    var total = vec3f(0.0);
    for (var bounce = 0u; bounce < LAST_BOUNCE; bounce++) {
        let seen = sight_along(origin, direction, FARTHEST);
        if !seen.is_hit {
            return total + throughput * sky_radiance(direction);
        }
        let reflected = brdf_lambert(seen.albedo, lamps_irradiance(seen.position, seen.normal));
        total += throughput * (seen.emission + reflected);
        throughput *= seen.albedo;
        let u = random_uniform(random_hash(vec3u(key, bounce + 1u, settings.seed)));
        if bounce >= ROULETTE_BOUNCE {
            let survival = min(max(throughput.r, max(throughput.g, throughput.b)), 0.95);
            if u.z >= survival {
                return total;
            }
            throughput /= survival;
        }
        origin = seen.position;
        direction = cosine_direction(seen.normal, u.xy);
    }
    return total;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let index = id.x + settings.row * id.y;
    if id.x >= settings.row || index >= settings.count {
        return;
    }
    let normal = points[2u * index + 1u].xyz;
    let start = sight_start(points[2u * index].xyz, normal);
    if start.w == 0.0 {
        return;
    }
    var sum = sums[index];
    for (var i = 0u; i < settings.samples; i++) {
        let key = random_hash(vec3u(index, settings.first_sample + i, settings.seed)).x;
        let u = random_uniform(random_hash(vec3u(key, 0u, settings.seed)));
        let irradiance = PI * path_radiance(start.xyz, cosine_direction(normal, u.xy), key);
        let mean = dot(irradiance, vec3f(1.0 / 3.0));
        sum += vec4f(irradiance, mean * mean);
    }
    sums[index] = sum;
}
