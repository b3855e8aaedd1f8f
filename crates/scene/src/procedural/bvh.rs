//! A bounding volume hierarchy over shapes.

use glam::DVec3;

use super::convex::Line;
use super::shape::{Hit, Shape};

const LEAF: usize = 3;

#[derive(Clone, Debug)]
struct Node {
    min: DVec3,
    max: DVec3,
    /// Leaves: the first of `count` entries of `order`. Inner nodes (`count` 0): the second child;
    /// the first follows the node itself.
    start: usize,
    count: usize,
}

/// Shapes sorted into nested boxes: finds the nearest hit in logarithmic time.
#[derive(Clone, Debug)]
pub(super) struct Bvh {
    nodes: Vec<Node>,
    order: Vec<usize>,
}

impl Bvh {
    /// Median splits along the longest axis of the centres.
    pub fn new(shapes: &[&Shape]) -> Self {
        let bounds: Vec<_> = shapes.iter().map(|s| s.bounds()).collect();
        let mut bvh = Self { nodes: Vec::new(), order: (0..shapes.len()).collect() };
        if !shapes.is_empty() {
            bvh.build(&bounds, 0, shapes.len());
        }
        bvh
    }

    fn build(&mut self, bounds: &[(DVec3, DVec3)], start: usize, end: usize) {
        let items = &mut self.order[start..end];
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (mut least, mut most) = (min, max);
        for &i in items.iter() {
            let (lo, hi) = bounds[i];
            (min, max) = (min.min(lo), max.max(hi));
            (least, most) = (least.min(lo + hi), most.max(lo + hi));
        }
        let node = self.nodes.len();
        self.nodes.push(Node { min, max, start, count: end - start });
        if end - start <= LEAF {
            return;
        }
        let extent = most - least;
        let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
        let key = |i: usize| bounds[i].0[axis] + bounds[i].1[axis];
        items.sort_by(|&a, &b| key(a).total_cmp(&key(b)));
        let middle = start + (end - start) / 2;
        self.build(bounds, start, middle);
        self.nodes[node].start = self.nodes.len();
        self.nodes[node].count = 0;
        self.build(bounds, middle, end);
    }

    /// The nearest hit before `farthest` and the index of what was hit.
    pub fn nearest(&self, shape: impl Fn(usize) -> Shaped<'_>, line: &Line, farthest: f64) -> Option<(usize, Hit)> {
        let mut best = None;
        let mut reach = farthest;
        self.visit(line, &mut reach, |i, reach| {
            if let Some(hit) = shape(i).hit(line, *reach) {
                *reach = hit.t;
                best = Some((i, hit));
            }
            false
        });
        best
    }

    /// Whether anything is hit before `farthest`.
    pub fn any(&self, shape: impl Fn(usize) -> Shaped<'_>, line: &Line, farthest: f64) -> bool {
        let mut reach = farthest;
        self.visit(line, &mut reach, |i, reach| shape(i).hit(line, *reach).is_some())
    }

    /// Calls `leaf` for shapes whose boxes the line meets before `reach`, until it returns true.
    fn visit(&self, line: &Line, reach: &mut f64, mut leaf: impl FnMut(usize, &mut f64) -> bool) -> bool {
        let inverse = line.direction.recip();
        let enter = |node: &Node, reach: f64| {
            let a = (node.min - line.origin) * inverse;
            let b = (node.max - line.origin) * inverse;
            let near = a.min(b).max_element().max(0.0);
            let far = a.max(b).min_element().min(reach);
            (near <= far).then_some(near)
        };
        let mut stack = [0usize; 64];
        let mut top = 0;
        match self.nodes.first() {
            Some(root) if enter(root, *reach).is_some() => {}
            _ => return false,
        }
        let mut at = 0;
        loop {
            let node = &self.nodes[at];
            if node.count > 0 {
                for &i in &self.order[node.start..node.start + node.count] {
                    if leaf(i, reach) {
                        return true;
                    }
                }
            } else {
                let (first, second) = (at + 1, node.start);
                let a = enter(&self.nodes[first], *reach);
                let b = enter(&self.nodes[second], *reach);
                match (a, b) {
                    (Some(a), Some(b)) => {
                        let (next, later) = if a <= b { (first, second) } else { (second, first) };
                        // Median splits keep the tree's depth, and so the stack, below 64.
                        stack[top] = later;
                        top += 1;
                        at = next;
                        continue;
                    }
                    (Some(_), None) => {
                        at = first;
                        continue;
                    }
                    (None, Some(_)) => {
                        at = second;
                        continue;
                    }
                    (None, None) => {}
                }
            }
            loop {
                if top == 0 {
                    return false;
                }
                top -= 1;
                at = stack[top];
                if enter(&self.nodes[at], *reach).is_some() {
                    break;
                }
            }
        }
    }
}

/// A borrowed shape.
pub(super) type Shaped<'a> = &'a Shape;
