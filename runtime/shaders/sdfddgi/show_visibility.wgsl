// How much of the probes around it each pixel's surface sees: the sum of their trilinear weights times their visibility.
// Black sees none of the eight, so that the next ring answers, or the sky.

import package::lib::frame::{frame, frame_position, frame_towards_viewer};
import package::lib::march::{trace_start_seen};
import package::primary::gbuffer::{gbuffer_depth, gbuffer_face_normal};
import package::probes::cells::{cell_weight};
import package::probes::grid::{probe_cell, probe_corner, probe_index};
import package::sdfddgi::lookup::{probe_visibility};

@group(0) @binding(5) var layer: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.size) {
        return;
    }
    let depth = textureLoad(gbuffer_depth, id.xy, 0);
    if depth == 0.0 {
        textureStore(layer, id.xy, vec4f(0.0));
        return;
    }
    let position = frame_position(id.xy, depth);
    let start = trace_start_seen(position, gbuffer_face_normal(id.xy), frame_towards_viewer(position));
    var seen = 0.0;
    if start.w > 0.0 {
        let cell = probe_cell(start.xyz);
        for (var corner = 0u; corner < 8u; corner++) {
            let weight = cell_weight(cell, corner);
            if weight > 0.0 {
                seen += weight * probe_visibility(probe_index(probe_corner(cell, corner)), start.xyz);
            }
        }
    }
    textureStore(layer, id.xy, vec4f(vec3f(seen), 1.0));
}
