// Irradiance at given points by path tracing (Kajiya 1986): cosine-weighted rays, direct light of every lamp and of one
// point that shines at every bounce, unlimited bounces ended by Russian roulette. What shines is met by chance, too: both
// ways are combined by the balance heuristic (Veach and Guibas 1995). Adds its samples to those of the dispatches before.

import package::lib::brdf::{brdf_lambert};
import package::lib::emitters::{emitter_density_along};
import package::lib::random::{PI, random_cosine_direction, random_hash, random_uniform};
import package::lib::sky::{sky_radiance};
import package::paths::emitters::{emitter_light};
import package::paths::lamps::{lamps_irradiance};
import package::structs::{PathSettings};
import package::tracer::emitters::{emitter_count};
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

// Added to the number of a bounce for the random numbers of its draw of an emitter.
const DRAW_KEY: u32 = 1024u;

// Radiance of an emitter that is drawn, and not met by chance, for a surface with this normal: its mean over draws and
// over cosine-weighted rays, weighted against each other, is that of the hemisphere.
fn drawn_radiance(origin: vec3f, normal: vec3f, key: u32, bounce: u32) -> vec3f {
    if emitter_count() == 0u {
        return vec3f(0.0);
    }
    let u = random_uniform(random_hash(vec3u(key, DRAW_KEY + bounce, settings.seed)));
    let light = emitter_light(origin, FARTHEST, u);
    let chance = dot(normal, light.direction) / PI;
    if !light.is_met || chance <= 0.0 {
        return vec3f(0.0);
    }
    let density = emitter_density_along(light.seen);
    return light.seen.emission * (chance / light.density * density / (chance + density));
}

// Mean radiance from the hemisphere over a surface, weighted by the cosine.
fn path_radiance(from_point: vec3f, from_normal: vec3f, key: u32) -> vec3f {
    var origin = from_point;
    var normal = from_normal;
    var throughput = vec3f(1.0);
    var total = vec3f(0.0);
    for (var bounce = 0u; bounce < LAST_BOUNCE; bounce++) {
        let u = random_uniform(random_hash(vec3u(key, bounce, settings.seed)));
        let direction = random_cosine_direction(normal, u.xy);
        total += throughput * drawn_radiance(origin, normal, key, bounce);
        let seen = sight_along(origin, direction, FARTHEST);
        if !seen.is_hit {
            return total + throughput * sky_radiance(direction);
        }
        let reflected = brdf_lambert(seen.albedo, lamps_irradiance(seen.position, seen.normal));
        let chance = max(dot(normal, direction), 1e-6) / PI;
        total += throughput * (seen.emission * (chance / (chance + emitter_density_along(seen))) + reflected);
        throughput *= seen.albedo;
        if bounce >= ROULETTE_BOUNCE {
            let survival = min(max(throughput.r, max(throughput.g, throughput.b)), 0.95);
            if u.z >= survival {
                return total;
            }
            throughput /= survival;
        }
        origin = seen.position;
        normal = seen.normal;
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
        let irradiance = PI * path_radiance(start.xyz, normal, key);
        let mean = dot(irradiance, vec3f(1.0 / 3.0));
        sum += vec4f(irradiance, mean * mean);
    }
    sums[index] = sum;
}
