// Radiance of every pixel: rho (E_direct + E_indirect) / pi + emission, or the sky where there is no surface.

import package::lib::brdf::{brdf_lambert};
import package::lib::frame::{frame, frame_ray};
import package::lib::sky::{sky_radiance};
import package::primary::gbuffer::{gbuffer_albedo, gbuffer_depth, gbuffer_emission};

@group(0) @binding(8) var direct_irradiance: texture_2d<f32>;
@group(0) @binding(9) var indirect_irradiance: texture_2d<f32>;
@group(0) @binding(10) var radiance: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.size) {
        return;
    }
    var total: vec3f;
    if textureLoad(gbuffer_depth, id.xy, 0) > 0.0 {
        let direct = textureLoad(direct_irradiance, id.xy, 0).rgb;
        let indirect = textureLoad(indirect_irradiance, id.xy, 0).rgb;
        let albedo = textureLoad(gbuffer_albedo, id.xy, 0).rgb;
        total = brdf_lambert(albedo, direct + indirect) + textureLoad(gbuffer_emission, id.xy, 0).rgb;
    } else {
        total = sky_radiance(frame_ray(id.xy).direction);
    }
    textureStore(radiance, id.xy, vec4f(total, 1.0));
}
