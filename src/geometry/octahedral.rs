//! The octahedral map: the sphere unfolded onto a square without poles
//! (Meyer et al. 2010, *On Floating-Point Normal Vectors*).

use glam::{Vec2, Vec3};

/// A unit direction's place in the unit square.
#[inline]
pub fn octahedral_from_direction(d: Vec3) -> Vec2 {
    let p = d / (d.x.abs() + d.y.abs() + d.z.abs());
    let folded = if p.z >= 0.0 {
        Vec2::new(p.x, p.y)
    } else {
        Vec2::new(
            (1.0 - p.y.abs()).copysign(p.x),
            (1.0 - p.x.abs()).copysign(p.y),
        )
    };
    0.5 * folded + Vec2::splat(0.5)
}

/// The unit direction at a place in the unit square; the inverse of
/// [`octahedral_from_direction`].
#[inline]
pub fn direction_from_octahedral(uv: Vec2) -> Vec3 {
    let p = 2.0 * uv - Vec2::ONE;
    let z = 1.0 - p.x.abs() - p.y.abs();
    let fold = (-z).max(0.0);
    Vec3::new(p.x - fold.copysign(p.x), p.y - fold.copysign(p.y), z).normalize()
}

/// The cell of an `n × n` octahedral grid at `(x, y)`, where indices one outside the grid fold
/// over its edge to the neighbour on the sphere.
#[inline]
pub fn octahedral_neighbour(n: usize, x: isize, y: isize) -> usize {
    let last = n as isize - 1;
    let (mut x, mut y) = (x, y);
    if x < 0 || x > last {
        x = if x < 0 { 0 } else { last };
        y = last - y;
    }
    if y < 0 || y > last {
        y = if y < 0 { 0 } else { last };
        x = last - x;
    }
    y.clamp(0, last) as usize * n + x.clamp(0, last) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn octahedral_inverts(x in -1.0f32..1.0, y in -1.0f32..1.0, z in -1.0f32..1.0) {
            prop_assume!(Vec3::new(x, y, z).length() > 1e-3);
            let d = Vec3::new(x, y, z).normalize();
            prop_assert!((direction_from_octahedral(octahedral_from_direction(d)) - d).length() < 1e-5);
        }
    }

    #[test]
    fn neighbours_are_near_on_the_sphere() {
        let n = 16;
        let centre = |cell: usize| {
            let uv = Vec2::new((cell % n) as f32 + 0.5, (cell / n) as f32 + 0.5) / n as f32;
            direction_from_octahedral(uv)
        };
        for y in 0..n as isize {
            for x in 0..n as isize {
                let here = centre(y as usize * n + x as usize);
                for (dx, dy) in [(-1, 0), (1, 0), (0, -1), (0, 1)] {
                    let there = centre(octahedral_neighbour(n, x + dx, y + dy));
                    assert!(here.angle_between(there) < 0.35, "{x} {y} {dx} {dy}");
                }
            }
        }
    }
}
