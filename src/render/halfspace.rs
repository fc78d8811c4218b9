//! Whether all of a mesh lies below a plane: then nothing is in the way above it.

use glam::Vec3;

/// Vertices of a leaf.
const LEAF: usize = 8;
/// How far a vertex may rise above a plane and still count as lying in it, in mesh units: rounding of
/// coordinates of magnitude one, a hundredth of a ray's own offset.
const TOLERANCE: f32 = 2e-7;

/// The vertices of a mesh in a tree of boxes.
#[derive(Clone, Debug)]
pub(super) struct VertexTree {
    /// In an order in which every box holds a range.
    vertices: Vec<Vec3>,
    nodes: Vec<Node>,
}

#[derive(Clone, Debug)]
struct Node {
    low: Vec3,
    high: Vec3,
    start: u32,
    end: u32,
    /// Index of the second child; the first follows its parent. 0 for leaves.
    second: u32,
}

impl VertexTree {
    pub(super) fn new(positions: &[Vec3]) -> Self {
        let mut tree = Self {
            vertices: positions.to_vec(),
            nodes: Vec::new(),
        };
        if !positions.is_empty() {
            tree.divide(0, positions.len());
        }
        tree
    }

    fn divide(&mut self, start: usize, end: usize) {
        let part = &mut self.vertices[start..end];
        let low = part.iter().copied().fold(Vec3::MAX, Vec3::min);
        let high = part.iter().copied().fold(Vec3::MIN, Vec3::max);
        let node = self.nodes.len();
        self.nodes.push(Node {
            low,
            high,
            start: start as u32,
            end: end as u32,
            second: 0,
        });
        if end - start <= LEAF {
            return;
        }
        let axis = (high - low).max_position();
        let middle = (end - start) / 2;
        part.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
        self.divide(start, start + middle);
        self.nodes[node].second = self.nodes.len() as u32;
        self.divide(start + middle, end);
    }

    /// Whether no vertex lies above the plane through `point` with unit normal `normal`.
    pub(super) fn is_below(&self, point: Vec3, normal: Vec3) -> bool {
        let height = normal.dot(point) + TOLERANCE;
        let mut waiting = vec![0];
        while let Some(index) = waiting.pop() {
            let Some(node) = self.nodes.get(index as usize) else {
                continue;
            };
            // The corner of the box that lies highest above the plane.
            let corner = Vec3::select(normal.cmpge(Vec3::ZERO), node.high, node.low);
            if normal.dot(corner) <= height {
                continue;
            }
            if node.second == 0 {
                let vertices = &self.vertices[node.start as usize..node.end as usize];
                if vertices.iter().any(|v| normal.dot(*v) > height) {
                    return false;
                }
            } else {
                waiting.extend([node.second, index + 1]);
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn tree_agrees_with_every_vertex(
            points in prop::collection::vec((-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0), 1..200),
            plane in (-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0),
            chosen in 0usize..200,
        ) {
            let normal = Vec3::from(plane);
            prop_assume!(normal.length() > 1e-2);
            let normal = normal.normalize();
            let points: Vec<Vec3> = points.into_iter().map(Vec3::from).collect();
            // Also planes that all points are below.
            let highest = points.iter().copied().max_by(|a, b| normal.dot(*a).total_cmp(&normal.dot(*b))).unwrap();
            let point = if chosen.is_multiple_of(2) { highest } else { points[chosen % points.len()] };
            let height = normal.dot(point) + TOLERANCE;
            let expected = points.iter().all(|p| normal.dot(*p) <= height);
            prop_assert_eq!(VertexTree::new(&points).is_below(point, normal), expected);
        }
    }
}
