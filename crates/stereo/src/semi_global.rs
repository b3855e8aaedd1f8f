//! Semi-global matching (Hirschmüller 2008).

use infonerf_scene::image::GreyImage;
use rayon::prelude::*;

/// Cost of a step to the next plane between neighbouring pixels.
const SMALL_STEP: f32 = 0.02;
/// Cost of a larger step in uniform areas of the image; less across an edge.
const LARGE_STEP: f32 = 0.25;
/// Difference in grey values that halves [`LARGE_STEP`].
const EDGE: f32 = 0.05;

const DIRECTIONS: [(isize, isize); 8] = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1), (1, -1), (-1, 1)];

/// Returns the best plane of each pixel, refined between planes by a parabola through its cost and its neighbours'.
///
/// Along each direction r, `L(p, d) = C(p, d) + min(L(q, d), L(q, d ± 1) + P₁, min L(q) + P₂) − min L(q)` with q = p −
/// r (Eq. 13). The best plane has the min ΣL.
pub(crate) fn labels(costs: &[f32], planes: usize, guide: &GreyImage) -> Vec<f32> {
    let add = |mut sum: Vec<f32>, costs: Vec<f32>| {
        sum.iter_mut().zip(&costs).for_each(|(sum, cost)| *sum += cost);
        sum
    };
    let aggregated = DIRECTIONS.par_iter().map(|&direction| aggregated(costs, planes, guide, direction));
    let total = aggregated.reduce_with(add).unwrap_or_default();
    total.chunks_exact(planes).map(refined_minimum).collect()
}

fn aggregated(costs: &[f32], planes: usize, guide: &GreyImage, (dx, dy): (isize, isize)) -> Vec<f32> {
    let (width, height) = (guide.width, guide.height);
    let mut total = vec![0.0; costs.len()];
    for j in 0..height {
        let y = if dy < 0 { height - 1 - j } else { j };
        for i in 0..width {
            let x = if dx < 0 { width - 1 - i } else { i };
            let pixel = y * width + x;
            let cost = &costs[pixel * planes..][..planes];
            let (fx, fy) = (x.wrapping_add_signed(-dx), y.wrapping_add_signed(-dy));
            if fx >= width || fy >= height {
                total[pixel * planes..][..planes].copy_from_slice(cost);
                continue;
            }
            let before = fy * width + fx;
            let large = LARGE_STEP / (1.0 + (guide.values[pixel] - guide.values[before]).abs() / EDGE);
            let range = |pixel: usize| pixel * planes..(pixel + 1) * planes;
            if let Ok([from, to]) = total.get_disjoint_mut([range(before), range(pixel)]) {
                step(cost, from, to, large.max(SMALL_STEP));
            }
        }
    }
    total
}

/// Computes the costs of one pixel from the costs of the pixel before it.
fn step(cost: &[f32], from: &[f32], to: &mut [f32], large: f32) {
    let least = from.iter().copied().fold(f32::INFINITY, f32::min);
    let stay = |d: usize| from[d].min(least + large);
    let last = cost.len() - 1;
    to[0] = cost[0] + stay(0).min(from[1.min(last)] + SMALL_STEP) - least;
    to[last] = cost[last] + stay(last).min(from[last.saturating_sub(1)] + SMALL_STEP) - least;
    for (((to, cost), before), window) in to[1..].iter_mut().zip(&cost[1..]).zip(&from[1..]).zip(from.windows(3)) {
        let move_one = window[0].min(window[2]) + SMALL_STEP;
        *to = cost + before.min(least + large).min(move_one) - least;
    }
}

/// Returns the index of the min of `costs`, refined to a fraction by a parabola through it and its neighbours.
fn refined_minimum(costs: &[f32]) -> f32 {
    let best = (0..costs.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).unwrap_or(0);
    if best == 0 || best + 1 == costs.len() {
        return best as f32;
    }
    let (below, least, above) = (costs[best - 1], costs[best], costs[best + 1]);
    let curvature = below - 2.0 * least + above;
    let shift = if curvature > 0.0 { 0.5 * (below - above) / curvature } else { 0.0 };
    best as f32 + shift.clamp(-0.5, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ambiguous_pixel_takes_its_neighbours_plane() {
        let guide = GreyImage { width: 5, height: 3, values: vec![0.5; 15] };
        let mut costs = [1.0, 1.0, 0.1, 1.0, 1.0, 1.0].repeat(15);
        // One pixel prefers another plane by a little.
        costs[7 * 6 + 5] = 0.05;
        let found = labels(&costs, 6, &guide);
        assert!(found.iter().all(|label| (label - 2.0).abs() < 1e-3), "{found:?}");
    }

    /// Checks that a plane spreads from the pixel at which each direction begins.
    #[test]
    fn costs_are_summed_along_each_direction() {
        let guide = GreyImage { width: 3, height: 3, values: vec![0.5; 9] };
        for (dx, dy) in DIRECTIONS {
            let pixel = |steps: isize| ((1 + steps * dy) * 3 + 1 + steps * dx) as usize;
            let mut costs = vec![0.5; 9 * 4];
            costs[pixel(-1) * 4 + 1] = 0.0;
            let sums = aggregated(&costs, 4, &guide, (dx, dy));
            assert_eq!(refined_minimum(&sums[pixel(1) * 4..][..4]), 1.0, "{dx} {dy}");
        }
    }

    #[test]
    fn an_edge_of_the_picture_may_be_one_of_depth() {
        let values = (0..8).map(|x| if x < 4 { 0.1 } else { 0.9 }).collect();
        let guide = GreyImage { width: 8, height: 1, values };
        let mut costs = vec![0.6; 8 * 9];
        for x in 0..8 {
            costs[x * 9 + if x < 4 { 1 } else { 7 }] = 0.1;
        }
        let found = labels(&costs, 9, &guide);
        assert!(found[..4].iter().all(|label| (label - 1.0).abs() < 0.5), "{found:?}");
        assert!(found[4..].iter().all(|label| (label - 7.0).abs() < 0.5), "{found:?}");
    }

    #[test]
    fn minima_are_refined() {
        let parabola = |x: f32| (0..7).map(|d| (d as f32 - x).powi(2)).collect::<Vec<_>>();
        approx::assert_abs_diff_eq!(refined_minimum(&parabola(3.3)), 3.3, epsilon = 1e-4);
        assert_eq!(refined_minimum(&parabola(-1.0)), 0.0);
    }
}
