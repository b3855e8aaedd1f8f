use glam::DVec3;
use rand::Rng;

/// Number of steps of the enclosing-ball iteration; the error of its centre is then about 1 %.
const STEPS: usize = 200;

/// All unit vectors within `half_angle` radians of `axis`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cap {
    pub axis: DVec3,
    pub half_angle: f64,
}

impl Cap {
    /// Returns the smallest cap that holds all `directions`, to about 1 % in the axis; the angle is exactly
    /// that of the direction farthest from it.
    ///
    /// The axis is the centre of the smallest ball around the directions (Bădoiu and Clarkson's iteration: step towards the
    /// farthest point by 1/(k+1)), or `fallback` where that is the sphere's centre: the cap is then most of the sphere.
    pub fn enclosing(directions: &[DVec3], fallback: DVec3) -> Self {
        let mut centre = directions.first().copied().unwrap_or(fallback);
        for k in 1..=STEPS {
            let nearer = |a: &&DVec3, b: &&DVec3| a.distance_squared(centre).total_cmp(&b.distance_squared(centre));
            let farthest = directions.iter().max_by(nearer).copied().unwrap_or(centre);
            centre += (farthest - centre) / (k + 1) as f64;
        }
        let axis = if centre.length() > 0.02 { centre.normalize_or(fallback) } else { fallback };
        let half_angle = directions.iter().map(|&d| angle(axis, d)).fold(0.0, f64::max);
        Self { axis, half_angle }
    }

    /// Returns a direction uniform by area.
    pub fn sample(&self, rng: &mut impl Rng) -> DVec3 {
        let lowest = self.half_angle.min(std::f64::consts::PI).cos();
        let along = 1.0 - rng.random::<f64>() * (1.0 - lowest);
        let turn = std::f64::consts::TAU * rng.random::<f64>();
        let angle = along.clamp(-1.0, 1.0).acos();
        let (u, v) = self.axis.any_orthonormal_pair();
        let across = turn.cos() * u + turn.sin() * v;
        (angle.cos() * self.axis + angle.sin() * across).normalize_or(self.axis)
    }
}

/// Returns the angle between two unit vectors, accurate near 0 and π.
pub fn angle(a: DVec3, b: DVec3) -> f64 {
    2.0 * (a - b).length().atan2((a + b).length())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn samples_stay_inside_and_fill_it() {
        let cap = Cap { axis: DVec3::Y, half_angle: 0.6 };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let angles: Vec<_> = (0..2000).map(|_| angle(cap.sample(&mut rng), cap.axis)).collect();
        assert!(angles.iter().all(|&a| a <= 0.6 + 1e-9));
        // Half of the area lies beyond this angle.
        let middle = ((1.0 + 0.6f64.cos()) / 2.0).acos();
        let beyond = angles.iter().filter(|&&a| a > middle).count();
        assert!((900..1100).contains(&beyond), "{beyond}");
    }
}
