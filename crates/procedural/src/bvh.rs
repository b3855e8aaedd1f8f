//! A bounding volume hierarchy over shapes.

use glam::DVec3;

use super::convex::HalfLine;
use super::shape::{Hit, Shape};

/// Max number of shapes of a node that is not split.
const LEAF: usize = 2;
/// Max number of levels below the root.
const MAX_DEPTH: usize = 48;
/// The empty box.
const NOTHING: (DVec3, DVec3) = (DVec3::INFINITY, DVec3::NEG_INFINITY);

struct BvhNode {
    min: DVec3,
    max: DVec3,
    /// In leaves: index of the first of `count` entries of `order`. In inner nodes (`count` 0): index of the second
    /// child; the first child is the next node.
    start: usize,
    count: usize,
}

/// Shapes sorted into nested boxes: finds the nearest hit in logarithmic time.
pub(super) struct Bvh {
    nodes: Vec<BvhNode>,
    order: Vec<usize>,
}

impl Bvh {
    /// Builds the hierarchy. Splits minimize the sum of area times number of shapes of both boxes (surface-area heuristic).
    pub fn new(shapes: &[&Shape]) -> Self {
        let bounds: Vec<_> = shapes.iter().map(|s| s.bounds()).collect();
        let mut bvh = Self { nodes: Vec::new(), order: (0..shapes.len()).collect() };
        if !shapes.is_empty() {
            bvh.build(&bounds, 0, shapes.len(), 0);
        }
        bvh
    }

    fn build(&mut self, bounds: &[(DVec3, DVec3)], start: usize, end: usize, depth: usize) {
        let items = &mut self.order[start..end];
        let (min, max) = items.iter().fold(NOTHING, |b, &i| join(b, bounds[i]));
        let node = self.nodes.len();
        self.nodes.push(BvhNode { min, max, start, count: end - start });
        if end - start <= LEAF || depth == MAX_DEPTH {
            return;
        }
        let centre = |i: usize, axis: usize| bounds[i].0[axis] + bounds[i].1[axis];
        let mut best = (f64::INFINITY, 0, 0);
        for axis in 0..3 {
            items.sort_by(|&a, &b| centre(a, axis).total_cmp(&centre(b, axis)));
            // Cost of a split before item k: areas times counts of both sides.
            let mut right = NOTHING;
            let mut costs = vec![0.0; items.len()];
            for (k, &i) in items.iter().enumerate().rev() {
                right = join(right, bounds[i]);
                costs[k] = area(right) * (items.len() - k) as f64;
            }
            let mut left = NOTHING;
            for (k, &i) in items.iter().enumerate().take(items.len() - 1) {
                left = join(left, bounds[i]);
                let cost = area(left) * (k + 1) as f64 + costs[k + 1];
                if cost < best.0 {
                    best = (cost, axis, k + 1);
                }
            }
        }
        let (_, axis, split) = best;
        if split == 0 {
            return;
        }
        items.sort_by(|&a, &b| centre(a, axis).total_cmp(&centre(b, axis)));
        let middle = start + split;
        self.build(bounds, start, middle, depth + 1);
        self.nodes[node].start = self.nodes.len();
        self.nodes[node].count = 0;
        self.build(bounds, middle, end, depth + 1);
    }

    /// Finds the nearest hit and the index of its shape. `hit(i, t)` tests shape `i` up to distance `t`.
    pub fn nearest(&self, hit: impl Fn(usize, f64) -> Option<Hit>, line: &HalfLine) -> Option<(usize, Hit)> {
        let mut best = None;
        self.meet(line, &mut |i, reach| {
            if let Some(found) = hit(i, *reach) {
                *reach = found.t;
                best = Some((i, found));
            }
            false
        });
        best
    }

    pub fn any(&self, hit: impl Fn(usize, f64) -> Option<Hit>, line: &HalfLine) -> bool {
        self.meet(line, &mut |i, reach| hit(i, *reach).is_some())
    }

    /// Calls `leaf` for shapes whose boxes the line meets up to a distance, which `leaf` may reduce, until it returns true.
    fn meet(&self, line: &HalfLine, leaf: &mut impl FnMut(usize, &mut f64) -> bool) -> bool {
        let inverse = line.direction.recip();
        let enter = |node: usize| self.nodes.get(node)?.enter(line, inverse);
        enter(0).is_some() && self.visit(0, &enter, &mut { f64::INFINITY }, leaf)
    }

    /// Calls `leaf` for shapes below node `at`, nearer boxes first; `enter` returns the distance of a node's box.
    fn visit(
        &self,
        at: usize,
        enter: &impl Fn(usize) -> Option<f64>,
        reach: &mut f64,
        leaf: &mut impl FnMut(usize, &mut f64) -> bool,
    ) -> bool {
        let node = &self.nodes[at];
        if node.count > 0 {
            return self.order[node.start..][..node.count].iter().any(|&i| leaf(i, reach));
        }
        let mut children = [at + 1, node.start].map(|child| (enter(child).unwrap_or(f64::NAN), child));
        if children[1].0 < children[0].0 {
            children.swap(0, 1);
        }
        // A box that the line misses has the distance NaN.
        children.into_iter().any(|(near, child)| near <= *reach && self.visit(child, enter, reach, leaf))
    }
}

impl BvhNode {
    /// Returns the distance at which the line enters the node's box.
    fn enter(&self, line: &HalfLine, inverse: DVec3) -> Option<f64> {
        let a = (self.min - line.origin) * inverse;
        let b = (self.max - line.origin) * inverse;
        let near = a.min(b).max_element().max(0.0);
        let far = a.max(b).min_element();
        (near <= far).then_some(near)
    }
}

pub(super) fn join(a: (DVec3, DVec3), b: (DVec3, DVec3)) -> (DVec3, DVec3) {
    (a.0.min(b.0), a.1.max(b.1))
}

/// Computes half the surface area of a box.
fn area((min, max): (DVec3, DVec3)) -> f64 {
    let d = max - min;
    d.x * d.y + d.y * d.z + d.z * d.x
}
