//! Seams of a texture layout: edges of the surface whose two sides lie apart in the map.

use glam::DVec2;

use super::{Mesh, TexelGrid};

/// Samples of a seam a texel: two, so that none of the texels along it is stepped over.
const SAMPLES_A_TEXEL: f64 = 2.0;

/// How far inside its chart, in texels, a seam looks for the texel beside it: half a texel, where
/// most are, and where no centre is covered there, further in or on the edge itself.
const DEPTHS: [f64; 3] = [0.5, 1.0, 0.0];

/// One side of a seam, in texels.
struct Side {
    from: DVec2,
    along: DVec2,
    /// Unit normal into the chart.
    inward: DVec2,
}

impl Side {
    /// The side of a triangle with texture coordinates `ends` at the seam's ends, `third` opposite.
    fn new([from, to]: [DVec2; 2], third: DVec2) -> Option<Self> {
        let along = to - from;
        let inward = (third - from).reject_from(along.try_normalize()?);
        Some(Self {
            from,
            along,
            inward: inward.try_normalize()?,
        })
    }

    /// The texel point beside the seam, `t` of the way along it.
    fn beside(&self, grid: &TexelGrid, t: f64) -> Option<u32> {
        DEPTHS.into_iter().find_map(|depth| {
            let place = self.from + t * self.along + depth * self.inward;
            grid.point_at((place / f64::from(grid.resolution)).as_vec2())
        })
    }
}

/// Pairs of texel points that face each other over a seam, each once, the smaller first; ascending.
pub(super) fn facing(mesh: &Mesh, grid: &TexelGrid) -> Vec<(u32, u32)> {
    let Some(uvs) = &mesh.uvs else {
        return Vec::new();
    };
    let place = |vertex: u32| uvs[vertex as usize].as_dvec2() * f64::from(grid.resolution);
    let mut pairs = Vec::new();
    for edge in mesh.edges() {
        let Some(other) = edge.other else { continue };
        let same_place = |a: u32, b: u32| mesh.positions[a as usize] == mesh.positions[b as usize];
        // The ends and the corner opposite, as either triangle names them.
        let named_by = |triangle: u32| {
            let corners = mesh.triangles[triangle as usize];
            let [a, b] = edge
                .vertices
                .map(|end| corners.into_iter().find(|&corner| same_place(corner, end)));
            let (a, b) = (a?, b?);
            let third = corners.into_iter().find(|&c| c != a && c != b)?;
            Some(([place(a), place(b)], place(third)))
        };
        let (Some((here, third)), Some((there, opposite))) =
            (named_by(edge.triangle), named_by(other))
        else {
            continue;
        };
        if here == there {
            continue;
        }
        let (Some(here), Some(there)) = (Side::new(here, third), Side::new(there, opposite)) else {
            continue;
        };
        let length = here.along.length().max(there.along.length());
        let samples = (SAMPLES_A_TEXEL * length).ceil().max(1.0) as u32;
        pairs.extend((0..samples).filter_map(|sample| {
            let t = (f64::from(sample) + 0.5) / f64::from(samples);
            let (a, b) = (here.beside(grid, t)?, there.beside(grid, t)?);
            (a != b).then_some((a.min(b), a.max(b)))
        }));
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}
