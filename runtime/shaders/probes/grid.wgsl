// The grid that probes stand on. It may follow the viewer: then its outermost cells fade into what lies beyond.

import package::probes::cells::{ProbeCell, cell_around, cell_corner, cell_share, slot_at, slot_place};
import package::structs::{ProbeGridInfo};

@group(2) @binding(0) var<uniform> probe_grid: ProbeGridInfo;

fn probe_cell(position: vec3f) -> ProbeCell {
    return cell_around((position - probe_grid.lower) / probe_grid.spacing, probe_grid.counts);
}

fn probe_corner(cell: ProbeCell, corner: u32) -> vec3u {
    return cell_corner(cell, corner, probe_grid.counts);
}

// The probe at a place of the grid, and the place of one.
fn probe_index(place: vec3u) -> u32 {
    return slot_at(place, probe_grid.turn, probe_grid.counts);
}

fn probe_place(index: u32) -> vec3u {
    return slot_place(index, probe_grid.turn, probe_grid.counts);
}

// How many stand on the grid. The one after them stands nowhere: it sees the sky alone.
fn probe_count() -> u32 {
    return probe_grid.counts.x * probe_grid.counts.y * probe_grid.counts.z;
}

// Share of the grid's answer for a point; the rest is what `probe_sky_irradiance` makes of the sky.
fn probe_share(position: vec3f) -> f32 {
    let place = (position - probe_grid.lower) / probe_grid.spacing;
    return select(1.0, cell_share(place, probe_grid.counts), probe_grid.follows != 0u);
}
