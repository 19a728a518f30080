//! Nearest neighbours among points in space; a balanced tree in one array, without pointers.

use glam::DVec3;

/// Ranges this short are searched one by one: cheaper than to descend further.
const LEAF: usize = 8;

/// Points arranged so that the middle of every range splits it along the axis in which the range is widest.
#[derive(Clone, Debug)]
pub struct KdTree {
    points: Vec<DVec3>,
    /// Split axis of the middle of every range; unused for points in leaves.
    axes: Vec<u8>,
}

impl KdTree {
    /// Builds the tree; points that are not finite are left out.
    pub fn new(points: impl IntoIterator<Item = DVec3>) -> Self {
        let mut points: Vec<DVec3> = points.into_iter().filter(|p| p.is_finite()).collect();
        let mut axes = vec![0; points.len()];
        arrange(&mut points, &mut axes);
        Self { points, axes }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Distance to the nearest point, in the units of the points; `None` for an empty tree or a query that is not finite.
    pub fn nearest_distance(&self, query: DVec3) -> Option<f64> {
        if self.is_empty() || !query.is_finite() {
            return None;
        }
        let mut best2 = f64::INFINITY;
        self.search(0, self.points.len(), query, &mut best2);
        Some(best2.sqrt())
    }

    fn search(&self, start: usize, end: usize, query: DVec3, best2: &mut f64) {
        if end - start <= LEAF {
            for point in &self.points[start..end] {
                *best2 = best2.min(point.distance_squared(query));
            }
            return;
        }
        let middle = start + (end - start) / 2;
        let axis = self.axes[middle] as usize;
        let aside = query[axis] - self.points[middle][axis];
        *best2 = best2.min(self.points[middle].distance_squared(query));
        let halves = [(start, middle), (middle + 1, end)];
        let (near, far) = if aside < 0.0 { (halves[0], halves[1]) } else { (halves[1], halves[0]) };
        self.search(near.0, near.1, query, best2);
        if aside * aside < *best2 {
            self.search(far.0, far.1, query, best2);
        }
    }
}

fn arrange(points: &mut [DVec3], axes: &mut [u8]) {
    let n = points.len();
    if n <= LEAF {
        return;
    }
    let (low, high) = points.iter().fold((points[0], points[0]), |(low, high), p| (low.min(*p), high.max(*p)));
    let size = high - low;
    let axis = if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let middle = n / 2;
    points.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
    axes[middle] = axis as u8;
    let (left, right) = points.split_at_mut(middle);
    let (left_axes, right_axes) = axes.split_at_mut(middle);
    arrange(left, left_axes);
    arrange(&mut right[1..], &mut right_axes[1..]);
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg32;

    use super::*;

    #[test]
    fn agrees_with_trying_every_point() {
        let mut rng = Pcg32::seed_from_u64(1);
        for n in [1, 2, 9, 500] {
            // Small whole numbers: many equal coordinates and equal points.
            let mut point = || DVec3::from_array([(); 3].map(|()| f64::from(rng.random_range(-9..9))));
            let points: Vec<_> = (0..n).map(|_| point()).collect();
            let tree = KdTree::new(points.iter().copied().chain([DVec3::NAN]));
            assert_eq!(tree.len(), n);
            for _ in 0..200 {
                let query = point() + DVec3::new(0.3, 0.0, -0.2);
                let expected = points.iter().map(|p| p.distance(query)).fold(f64::INFINITY, f64::min);
                assert!((tree.nearest_distance(query).expect("points") - expected).abs() < 1e-12);
            }
        }
        assert_eq!(KdTree::new([]).nearest_distance(DVec3::ZERO), None);
        assert_eq!(KdTree::new([DVec3::ZERO]).nearest_distance(DVec3::NAN), None);
    }
}
