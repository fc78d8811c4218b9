//! Shading normals: the file's where they are sound, else angle-weighted means
//! (Thürmer and Wüthrich 1998, *Computing Vertex Normals from Polygonal Facets*).
//!
//! n(v) ∝ Σ_f angle_f(v) · n_f, over the faces f that meet at the position of v.

use glam::{DVec3, Vec3};

use super::{MeshReport, topology};

/// Shortest normal of a file that still has a direction.
const SHORTEST_NORMAL: f32 = 1e-20;

/// One unit normal a vertex.
///
/// The faces of a closed surface are known to look outwards, so normals yield to them; on an open
/// surface nothing but the file's normals tells the sides apart, so `triangles` yield to these.
pub(super) fn shading_normals(
    positions: &[Vec3],
    weld: &[u32],
    triangles: &mut [[u32; 3]],
    file_normals: Option<Vec<Vec3>>,
    closed: bool,
    report: &mut MeshReport,
) -> Vec<Vec3> {
    let mut sums = angle_weighted_sums(positions, weld, triangles);
    let Some(file_normals) = file_normals else {
        report.normals_computed = positions.len();
        return sums.computed(weld);
    };

    // Bring the file's normals to unit length, where they have one.
    let unit: Vec<Option<Vec3>> = file_normals
        .iter()
        .map(|n| {
            let largest = n.abs().max_element();
            (n.is_finite() && largest > SHORTEST_NORMAL).then(|| (*n / largest).normalize())
        })
        .collect();

    // Do faces and normals agree about which side is out?
    let agreement = |own: &DVec3, n: &Option<Vec3>| n.map_or(0.0, |n| own.dot(n.as_dvec3()));
    let (mut with, mut against) = (0, 0);
    for (own, n) in sums.own.iter().zip(&unit) {
        with += usize::from(agreement(own, n) > 0.0);
        against += usize::from(agreement(own, n) < 0.0);
    }
    let mut sign = 1.0;
    if against > with {
        if closed {
            sign = -1.0;
            report.normals_flipped = against;
        } else {
            report.turned_to_normals = 1;
            topology::turn_over(triangles);
            sums.negate();
        }
    }

    // Replace what still points nowhere or into the surface.
    let computed = sums.computed(weld);
    let mut normals = Vec::with_capacity(positions.len());
    for ((n, own), computed) in unit.iter().zip(&sums.own).zip(&computed) {
        let n = n.map(|n| n * sign).filter(|n| own.dot(n.as_dvec3()) >= 0.0);
        // A vertex of no face gets a normal too, but it is about to be dropped.
        report.normals_repaired += usize::from(n.is_none() && *own != DVec3::ZERO);
        normals.push(n.unwrap_or(*computed));
    }
    normals
}

/// Splits the kept vertices into those whose normal came from the file and those computed.
pub(super) fn count_kept(report: &mut MeshReport, vertices: usize) {
    if report.normals_computed > 0 {
        report.normals_computed = vertices;
    } else {
        report.normals_taken = vertices - report.normals_repaired.min(vertices);
    }
}

struct NormalSums {
    /// Over the faces that use the vertex itself.
    own: Vec<DVec3>,
    /// Over all faces at the vertex's position; kept at the first vertex there.
    welded: Vec<DVec3>,
}

impl NormalSums {
    fn computed(&self, weld: &[u32]) -> Vec<Vec3> {
        self.own
            .iter()
            .zip(weld)
            .map(|(own, &first)| {
                // Back-to-back faces cancel in the welded sum; then the vertex's own faces decide.
                let welded = self.welded[first as usize];
                let sum = if welded.length() > 1e-6 { welded } else { *own };
                sum.try_normalize().unwrap_or(DVec3::Y).as_vec3()
            })
            .collect()
    }

    fn negate(&mut self) {
        self.own
            .iter_mut()
            .chain(&mut self.welded)
            .for_each(|sum| *sum = -*sum);
    }
}

fn angle_weighted_sums(positions: &[Vec3], weld: &[u32], triangles: &[[u32; 3]]) -> NormalSums {
    let mut sums = NormalSums {
        own: vec![DVec3::ZERO; positions.len()],
        welded: vec![DVec3::ZERO; positions.len()],
    };
    for corners in triangles {
        let points = corners.map(|v| positions[v as usize].as_dvec3());
        let face = (points[1] - points[0])
            .cross(points[2] - points[0])
            .normalize_or_zero();
        for corner in 0..3 {
            let to_next = points[(corner + 1) % 3] - points[corner];
            let to_previous = points[(corner + 2) % 3] - points[corner];
            let weighted = face * to_next.angle_between(to_previous);
            let vertex = corners[corner] as usize;
            sums.own[vertex] += weighted;
            sums.welded[weld[vertex] as usize] += weighted;
        }
    }
    sums
}
