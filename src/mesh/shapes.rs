//! Shapes made in code: a sphere to check against formulas, a cup to cast shadows into itself.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec2, DVec3, Vec2};

use super::Surface;

/// A unit sphere of 8 `frequency`² triangles (at least 8) with exact normals.
///
/// Rows of equal latitude, four more vertices a row towards the equator: an octahedron's grid.
/// Triangles stay nearly equal as in an icosphere, but the texture's seam runs along one meridian,
/// so that the latitude-longitude coordinates fill the unit square once and nothing leaves it.
pub fn sphere(frequency: u32) -> Surface {
    let rows = 2 * frequency.max(1);
    let ring = |row: u32| row.min(rows - row);
    let mut surface = Surface::default();
    let mut normals = Vec::new();
    let mut uvs = Vec::new();

    // Vertices row by row; the last of a row repeats its first with u = 1, poles are four.
    let mut first_of_row = Vec::new();
    for row in 0..=rows {
        first_of_row.push(surface.positions.len() as u32);
        let v = f64::from(row) / f64::from(rows);
        // Exact at the poles and the equator.
        let (height, radius) = match (row, row == rows, 2 * row == rows) {
            (0, ..) => (1.0, 0.0),
            (_, true, _) => (-1.0, 0.0),
            (.., true) => (0.0, 1.0),
            _ => ((PI * v).cos(), (PI * v).sin()),
        };
        let segments = 4 * ring(row);
        let columns = if segments == 0 { 4 } else { segments + 1 };
        for column in 0..columns {
            let u = match segments {
                0 => (f64::from(column) + 0.5) / 4.0,
                _ => f64::from(column) / f64::from(segments),
            };
            let (sin_phi, cos_phi) = turn(column, segments.max(4));
            let direction = DVec3::new(radius * sin_phi, height, -radius * cos_phi);
            surface.positions.push(direction);
            normals.push(direction.as_vec3());
            uvs.push(DVec2::new(u, v).as_vec2());
        }
    }

    // Each quarter of a row is a strip between rings of r and r ± 1 segments.
    for (row, starts) in (0u32..).zip(first_of_row.windows(2)) {
        let (above, below) = (ring(row), ring(row + 1));
        for quarter in 0..4 {
            let corner = |start: u32, segments: u32, j: u32| match segments {
                0 => start + quarter,
                _ => start + quarter * segments + j,
            };
            let up = |j| corner(starts[0], above, j);
            let down = |j| corner(starts[1], below, j);
            if above < below {
                surface
                    .triangles
                    .extend((0..below).map(|j| [up(j), down(j + 1), down(j)]));
                surface
                    .triangles
                    .extend((0..above).map(|j| [up(j), up(j + 1), down(j + 1)]));
            } else {
                surface
                    .triangles
                    .extend((0..above).map(|j| [up(j), up(j + 1), down(j)]));
                surface
                    .triangles
                    .extend((0..below).map(|j| [up(j + 1), down(j + 1), down(j)]));
            }
        }
    }
    surface.normals = Some(normals);
    surface.uvs = Some(uvs);
    surface
}

/// A cup with walls of some thickness and, inside on its floor, a ball: 7,680 triangles, two closed
/// pieces, about one unit tall, +Y up. Its inside is shadowed and lights itself.
pub fn cup() -> Surface {
    const RADIUS: f64 = 0.4;
    const WALL: f64 = 0.05;
    const FLOOR: f64 = -0.4;
    const FOOT: f64 = FLOOR - WALL;
    const RIM: f64 = 0.45;
    const BALL: f64 = 0.14;
    const BALL_AT: DVec2 = DVec2::new(0.13, 0.05);
    // The ball stands this far above the floor, lest their triangles touch.
    const GAP: f64 = 1e-3;

    // The outline (radius, height) from the middle of the underside, around the rim, to the middle
    // of the floor.
    let mut outline = vec![DVec2::new(0.0, FOOT)];
    let inner = RADIUS - WALL;
    line_to(&mut outline, DVec2::new(RADIUS - 0.1, FOOT), 4);
    arc(
        &mut outline,
        DVec2::new(RADIUS - 0.1, FOOT + 0.1),
        0.1,
        -FRAC_PI_2,
        0.0,
        6,
    );
    line_to(&mut outline, DVec2::new(RADIUS, RIM - 0.5 * WALL), 12);
    arc(
        &mut outline,
        DVec2::new(RADIUS - 0.5 * WALL, RIM - 0.5 * WALL),
        0.5 * WALL,
        0.0,
        PI,
        8,
    );
    line_to(&mut outline, DVec2::new(inner, FLOOR + WALL), 12);
    arc(
        &mut outline,
        DVec2::new(inner - WALL, FLOOR + WALL),
        WALL,
        0.0,
        -FRAC_PI_2,
        6,
    );
    line_to(&mut outline, DVec2::new(0.0, FLOOR), 4);

    // The wall takes the upper part of the texture, the ball a rectangle below it.
    let mut surface = lathe(&outline, 64, [0.005, 0.005], [0.99, 0.69]);
    let mut ball = sphere(12);
    let centre = DVec3::new(BALL_AT.x, FLOOR + BALL + GAP, BALL_AT.y);
    ball.positions
        .iter_mut()
        .for_each(|position| *position = centre + BALL * *position);
    for uv in ball.uvs.iter_mut().flatten() {
        *uv = Vec2::new(0.005, 0.705) + Vec2::new(0.58, 0.29) * *uv;
    }
    let offset = surface.positions.len() as u32;
    surface.triangles.extend(
        ball.triangles
            .iter()
            .map(|t| t.map(|vertex| vertex + offset)),
    );
    surface.positions.append(&mut ball.positions);
    let join = |all: &mut Option<Vec<_>>, part: Option<Vec<_>>| {
        all.iter_mut()
            .for_each(|all| all.extend(part.iter().flatten()));
    };
    join(&mut surface.normals, ball.normals);
    surface
        .uvs
        .iter_mut()
        .for_each(|all| all.extend(ball.uvs.iter().flatten()));
    surface
}

/// Sine and cosine of `2π column/segments`, with the last column exactly on the first.
fn turn(column: u32, segments: u32) -> (f64, f64) {
    (TAU * f64::from(column % segments) / f64::from(segments)).sin_cos()
}

fn line_to(outline: &mut Vec<DVec2>, end: DVec2, steps: u32) {
    let start = *outline.last().unwrap_or(&end);
    outline.extend((1..=steps).map(|step| start.lerp(end, f64::from(step) / f64::from(steps))));
}

/// An arc from angle `from` (already on the outline) to angle `to`, radians.
fn arc(outline: &mut Vec<DVec2>, centre: DVec2, radius: f64, from: f64, to: f64, steps: u32) {
    outline.extend((1..=steps).map(|step| {
        let angle = from + (to - from) * f64::from(step) / f64::from(steps);
        centre + radius * DVec2::from_angle(angle)
    }));
}

/// The solid of revolution about +Y of an outline that starts and ends on the axis and keeps the
/// solid on its left. Texture: `u` around, `v` along the outline, in the given rectangle.
fn lathe(outline: &[DVec2], segments: u32, corner: [f64; 2], size: [f64; 2]) -> Surface {
    let mut surface = Surface::default();
    let (mut normals, mut uvs) = (Vec::new(), Vec::new());
    let length: f64 = outline
        .windows(2)
        .map(|pair| pair[0].distance(pair[1]))
        .sum();
    let mut travelled = 0.0;
    let last = outline.len() - 1;
    let mut first_of_row = Vec::new();
    for (i, point) in outline.iter().enumerate() {
        first_of_row.push(surface.positions.len() as u32);
        // The mean direction of the two segments, turned to the outside.
        let (previous, next) = (outline[i.saturating_sub(1)], outline[(i + 1).min(last)]);
        let before = (*point - previous).normalize_or_zero();
        let after = (next - *point).normalize_or_zero();
        let slope = -(before + after).perp().normalize_or_zero();
        travelled += point.distance(previous);
        // A pole has one vertex a segment, in its middle; a ring closes with a repeated vertex.
        let pole = i == 0 || i == last;
        let (columns, middle) = if pole {
            (segments, 0.5)
        } else {
            (segments + 1, 0.0)
        };
        for column in 0..columns {
            let (sin_phi, cos_phi) = turn(column, segments);
            let around = |p: DVec2| DVec3::new(p.x * sin_phi, p.y, -p.x * cos_phi);
            let u = (f64::from(column) + middle) / f64::from(segments);
            surface.positions.push(around(*point));
            normals.push(around(slope).as_vec3());
            let uv = DVec2::from(corner) + DVec2::from(size) * DVec2::new(u, travelled / length);
            uvs.push(uv.as_vec2());
        }
    }
    for (band, starts) in first_of_row.windows(2).enumerate() {
        for column in 0..segments {
            let [a, b] = [starts[0] + column, starts[1] + column];
            if band == 0 {
                surface.triangles.push([a, b, b + 1]);
            } else {
                surface.triangles.push([a, b, a + 1]);
                if band + 1 < last {
                    surface.triangles.push([b, b + 1, a + 1]);
                }
            }
        }
    }
    surface.normals = Some(normals);
    surface.uvs = Some(uvs);
    surface
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::{LoadOptions, Mesh, MeshReport};
    use super::*;
    use crate::geometry::{Similarity, latlong_from_direction};

    fn checked(surface: Surface) -> (Mesh, MeshReport) {
        let place = Similarity::default();
        Mesh::from_surface(surface, &place, LoadOptions::default(), Path::new("shape")).unwrap()
    }

    #[test]
    fn sphere_needs_no_repair() {
        for frequency in [0, 1, 2, 25] {
            let (mesh, report) = checked(sphere(frequency));
            assert_eq!(mesh.triangles.len() as u32, 8 * frequency.max(1).pow(2));
            let expected = MeshReport {
                components: 1,
                normals_taken: mesh.positions.len(),
                ..MeshReport::default()
            };
            assert_eq!(report, expected, "frequency {frequency}:\n{report}");
            assert_eq!(mesh.scale, 1.0);
        }
    }

    #[test]
    fn sphere_is_round_and_its_uvs_are_latlong() {
        let (mesh, _) = checked(sphere(9));
        let uvs = mesh.uvs.as_ref().unwrap();
        for (vertex, position) in mesh.positions.iter().enumerate() {
            assert!((position.length() - 1.0).abs() < 1e-6);
            assert!(mesh.normals[vertex].distance(*position) < 1e-6);
            let expected = latlong_from_direction(*position);
            assert!((uvs[vertex].y - expected.y).abs() < 1e-6);
            let around = (uvs[vertex].x - expected.x).rem_euclid(1.0);
            let pole = position.y.abs() == 1.0;
            assert!(
                pole || around.min(1.0 - around) < 1e-6,
                "{position}: {}",
                uvs[vertex]
            );
        }
        assert!(
            uvs.iter()
                .all(|uv| uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all())
        );
    }

    #[test]
    fn cup_is_two_closed_pieces_that_need_no_repair() {
        let (mesh, report) = checked(cup());
        let expected = MeshReport {
            components: 2,
            normals_taken: mesh.positions.len(),
            ..MeshReport::default()
        };
        assert_eq!(report, expected, "{report}");
        assert!(mesh.smooth && (0.9..1.1).contains(&(2.0 * mesh.scale)));
        println!("{} triangles", mesh.triangles.len());
    }

    #[test]
    fn ball_rests_in_the_cup_without_touching() {
        let (mesh, _) = checked(cup());
        // The ball's vertices come last; all the others keep their distance from its centre.
        let ball = sphere(12).positions.len();
        let positions = mesh
            .positions
            .iter()
            .map(|p| mesh.to_object(*p))
            .collect::<Vec<_>>();
        let (wall, ball) = positions.split_at(positions.len() - ball);
        let centre = ball.iter().sum::<DVec3>() / ball.len() as f64;
        let radius = ball[0].distance(centre);
        let nearest = wall
            .iter()
            .map(|p| p.distance(centre))
            .fold(f64::INFINITY, f64::min);
        assert!(nearest > radius, "{nearest} {radius}");
        let lowest = ball.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        assert!((lowest - (-0.4 + 1e-3)).abs() < 1e-6);
    }
}
