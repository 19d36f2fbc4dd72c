// Where the probes stand: in one grid, or in grids that follow the viewer, each twice as wide as the one before.

import package::probes::cells::{ProbeCell, cell_around, cell_corner, cell_share, slot_at, slot_place};
import package::structs::{DdgiCascade, DdgiInfo};

@group(2) @binding(0) var<uniform> ddgi: DdgiInfo;

fn cascade_cell(cascade: DdgiCascade, position: vec3f) -> ProbeCell {
    return cell_around((position - cascade.lower) / cascade.spacing, cascade.counts);
}

fn cascade_corner(cascade: DdgiCascade, cell: ProbeCell, corner: u32) -> vec3u {
    return cell_corner(cell, corner, cascade.counts);
}

// Share that a cascade has in the answer for a point: over its outermost cells the next one takes over.
fn cascade_share(number: u32, position: vec3f) -> f32 {
    if number + 1u == ddgi.cascade_count {
        return 1.0;
    }
    let cascade = ddgi.cascades[number];
    return cell_share((position - cascade.lower) / cascade.spacing, cascade.counts);
}

// The probe at a place of a cascade's grid, and the place of one.
fn cascade_probe(cascade: DdgiCascade, place: vec3u) -> u32 {
    return cascade.first + slot_at(place, cascade.turn, cascade.counts);
}

fn cascade_place(cascade: DdgiCascade, probe: u32) -> vec3u {
    return slot_place(probe - cascade.first, cascade.turn, cascade.counts);
}
