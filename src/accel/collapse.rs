//! From the binary to the eight-wide tree, at the least expected cost.
//!
//! A ray's expected work is the surface-area heuristic `Σ area(node) · cost + Σ area(leaf) · cost`.
//! For every binary subtree, and every number of slots it might be given in a wide node, dynamic
//! programming finds the division of least cost (Ylitie, Karras and Laine 2017, *Efficient
//! Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs*, Sec. 3.2):
//!
//! ```text
//! C(n, 1) = min(area(n) · pack  if n has ≤ 8 triangles,  area(n) · node + D(n, 8))
//! C(n, i) = min(D(n, i), C(n, i − 1)),   D(n, i) = min over 0 < k < i of C(left, k) + C(right, i − k)
//! ```

use glam::Vec3;

use super::build::{BinaryTree, Soup, box_of, enclose};
use super::wide_tree::{Child, Node, Pack, WIDTH, WideTree};

/// Cost of testing the triangles of a pack, in tests of a node.
///
/// Not critical: `benches/rays.rs` can't tell 0.65 from 1.0 (82 000 triangles, medians of five runs).
const PACK_COST: f32 = 0.65;

/// The best division of one binary subtree.
#[derive(Clone, Copy, Default)]
struct Plan {
    /// `[slots − 1]`: C(n, slots).
    cost: [f32; WIDTH - 1],
    /// `[slots − 1]`: how many of the slots the left child gets; 0: one slot fewer is as good. The
    /// last entry divides the node itself; 0 there: the subtree is one pack.
    left_slots: [u8; WIDTH],
    triangles: u32,
}

/// Something that becomes a child of a wide node.
#[derive(Clone, Copy)]
enum Subtree {
    /// A node of the binary tree.
    Binary(u32),
    /// A run of [`BinaryTree::members`] that share a centre.
    Members { first: u32, count: u32 },
}

/// Collapses `binary` over the triangles of `soup`.
pub(super) fn collapse(soup: Soup, binary: &BinaryTree) -> WideTree {
    let mut tree = WideTree {
        root: Child::NONE,
        nodes: Vec::new(),
        packs: Vec::new(),
    };
    if binary.groups.is_empty() {
        return tree;
    }
    let plans = plan(binary);
    let collapse = Collapse {
        soup,
        binary,
        plans,
    };

    // Depth first; each task knows the slot of its parent that it fills.
    let mut tasks: Vec<(Subtree, Option<(usize, usize)>)> = vec![(Subtree::Binary(0), None)];
    while let Some((subtree, place)) = tasks.pop() {
        let child = if let Some(triangles) = collapse.as_pack(subtree) {
            tree.packs
                .push(Pack::of(&triangles, |triangle| soup.corners(triangle)));
            Child::pack(tree.packs.len() - 1)
        } else {
            let index = tree.nodes.len();
            let mut node = Node::empty();
            let children = collapse.children(subtree);
            for (slot, &child) in children.iter().enumerate().rev() {
                let (lower, upper) = collapse.bounds(child);
                node.set(slot, Child::NONE, lower, upper);
                tasks.push((child, Some((index, slot))));
            }
            tree.nodes.push(node);
            Child::node(index)
        };
        match place {
            Some((parent, slot)) => tree.nodes[parent].children[slot] = child,
            None => tree.root = child,
        }
    }
    tree
}

/// The best division of every binary subtree, children before parents.
fn plan(binary: &BinaryTree) -> Vec<Plan> {
    let nodes = &binary.tree.nodes;
    let mut order = Vec::with_capacity(nodes.len());
    let mut open = vec![0];
    while let Some(index) = open.pop() {
        order.push(index);
        if !nodes[index as usize].is_leaf() {
            open.extend([
                nodes[index as usize].first_index,
                nodes[index as usize].first_index + 1,
            ]);
        }
    }

    let mut plans = vec![Plan::default(); nodes.len()];
    for &index in order.iter().rev() {
        let node = &nodes[index as usize];
        let area = node.aabb().half_area();
        plans[index as usize] = if node.is_leaf() {
            let triangles = group_of(binary, index).count;
            let packs = triangles.div_ceil(WIDTH as u32) as f32;
            Plan {
                cost: [area * (packs * PACK_COST + packs - 1.0); WIDTH - 1],
                left_slots: [0; WIDTH],
                triangles,
            }
        } else {
            let left = &plans[node.first_index as usize];
            let right = &plans[node.first_index as usize + 1];
            divide(area, left, right)
        };
    }
    plans
}

/// The plan of an inner node of the binary tree.
fn divide(area: f32, left: &Plan, right: &Plan) -> Plan {
    let mut plan = Plan {
        triangles: left.triangles + right.triangles,
        ..Plan::default()
    };
    let distribute = |slots: usize| {
        let mut best = (f32::INFINITY, 0);
        for k in 1..slots {
            let cost = left.cost[k - 1] + right.cost[slots - k - 1];
            if cost < best.0 {
                best = (cost, k as u8);
            }
        }
        best
    };

    let (divided, left_slots) = distribute(WIDTH);
    let as_node = area + divided;
    let as_pack = area * PACK_COST;
    let is_pack = plan.triangles <= WIDTH as u32 && as_pack <= as_node;
    plan.cost[0] = if is_pack { as_pack } else { as_node };
    plan.left_slots[WIDTH - 1] = if is_pack { 0 } else { left_slots.max(1) };
    for slots in 2..WIDTH {
        let (cost, left_slots) = distribute(slots);
        let divide = cost < plan.cost[slots - 2];
        plan.cost[slots - 1] = if divide { cost } else { plan.cost[slots - 2] };
        plan.left_slots[slots - 1] = if divide { left_slots } else { 0 };
    }
    plan
}

/// The group of a leaf of the binary tree.
fn group_of(binary: &BinaryTree, leaf: u32) -> super::build::Group {
    let first = binary.tree.nodes[leaf as usize].first_index;
    binary.groups[binary.tree.primitive_indices[first as usize] as usize]
}

/// The plans, and what they are about.
struct Collapse<'a> {
    soup: Soup<'a>,
    binary: &'a BinaryTree,
    plans: Vec<Plan>,
}

impl Collapse<'_> {
    /// The triangles of a subtree that is one pack, ascending.
    fn as_pack(&self, subtree: Subtree) -> Option<Vec<u32>> {
        let mut triangles = Vec::with_capacity(WIDTH);
        match subtree {
            Subtree::Members { first, count } if count <= WIDTH as u32 => {
                triangles.extend(&self.binary.members[first as usize..(first + count) as usize]);
            }
            Subtree::Binary(index) if self.is_pack(index) => {
                let mut open = vec![index];
                while let Some(index) = open.pop() {
                    let node = &self.binary.tree.nodes[index as usize];
                    if node.is_leaf() {
                        let group = group_of(self.binary, index);
                        let range = group.first as usize..(group.first + group.count) as usize;
                        triangles.extend(&self.binary.members[range]);
                    } else {
                        open.extend([node.first_index, node.first_index + 1]);
                    }
                }
            }
            _ => return None,
        }
        triangles.sort_unstable();
        Some(triangles)
    }

    fn is_pack(&self, index: u32) -> bool {
        let plan = &self.plans[index as usize];
        plan.left_slots[WIDTH - 1] == 0 && plan.triangles <= WIDTH as u32
    }

    /// The children of a subtree that is not one pack: two to eight.
    fn children(&self, subtree: Subtree) -> Vec<Subtree> {
        let mut children = Vec::with_capacity(WIDTH);
        match subtree {
            Subtree::Binary(index) if !self.binary.tree.nodes[index as usize].is_leaf() => {
                let left = self.binary.tree.nodes[index as usize].first_index;
                let left_slots = self.plans[index as usize].left_slots[WIDTH - 1] as usize;
                self.gather(left, left_slots, &mut children);
                self.gather(left + 1, WIDTH - left_slots, &mut children);
            }
            Subtree::Binary(index) => {
                let group = group_of(self.binary, index);
                split_members(group.first, group.count, &mut children);
            }
            Subtree::Members { first, count } => split_members(first, count, &mut children),
        }
        children
    }

    /// Divides `slots` slots among the parts of binary subtree `index`.
    fn gather(&self, index: u32, slots: usize, children: &mut Vec<Subtree>) {
        let plan = &self.plans[index as usize];
        let slots = (2..=slots)
            .rev()
            .find(|&slots| plan.left_slots[slots - 1] != 0)
            .unwrap_or(1);
        if slots == 1 {
            children.push(Subtree::Binary(index));
            return;
        }
        let left = self.binary.tree.nodes[index as usize].first_index;
        let left_slots = plan.left_slots[slots - 1] as usize;
        self.gather(left, left_slots, children);
        self.gather(left + 1, slots - left_slots, children);
    }

    fn bounds(&self, subtree: Subtree) -> (Vec3, Vec3) {
        match subtree {
            Subtree::Binary(index) => {
                let aabb = self.binary.tree.nodes[index as usize].aabb();
                enclose(std::iter::once((
                    Vec3::from(aabb.min) / self.binary.scale,
                    Vec3::from(aabb.max) / self.binary.scale,
                )))
            }
            Subtree::Members { first, count } => {
                let range = first as usize..(first + count) as usize;
                box_of(self.soup, &self.binary.members[range])
            }
        }
    }
}

/// Cuts a run of triangles with a common centre into at most eight runs of whole packs.
fn split_members(first: u32, count: u32, children: &mut Vec<Subtree>) {
    let packs = count.div_ceil(WIDTH as u32);
    let run = packs.div_ceil(WIDTH as u32) * WIDTH as u32;
    for start in (0..count).step_by(run as usize) {
        children.push(Subtree::Members {
            first: first + start,
            count: run.min(count - start),
        });
    }
}
