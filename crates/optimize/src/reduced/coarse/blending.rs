//! Smooth weights of images in clusters: without them the coarse space has jumps where clusters meet.

use super::clusters::Covisibility;

/// Share of its own weight an image keeps in a round; the rest comes from its neighbours (source: `scale.md` §3.2).
const KEPT: f64 = 0.3;
/// Rounds of smoothing (source: `scale.md` §5).
const ROUNDS: usize = 3;
/// Clusters an image may belong to. `scale.md` §5 takes 2, its figures 3; on circuits 2 takes a fifth more products
/// (`docs/preconditioner.md`).
pub(crate) const MAX_MEMBERSHIPS: usize = 3;
/// Smaller weights are dropped (source: `scale.md` §5).
const LEAST: f64 = 0.02;

/// For each image, its clusters and weights, largest first; the weights sum to 1. Empty where the image has no cluster.
pub(crate) fn blend(covisibility: &Covisibility, cluster: &[Option<u32>]) -> Vec<Vec<(u32, f64)>> {
    let count = cluster.iter().flatten().max().map_or(0, |&c| c as usize + 1);
    let mut weights: Vec<Vec<f64>> = cluster
        .iter()
        .map(|c| {
            let mut row = vec![0.0; count];
            c.iter().for_each(|&c| row[c as usize] = 1.0);
            row
        })
        .collect();
    for _ in 0..ROUNDS {
        let smooth = |i: usize| {
            let neighbours = covisibility.row(i);
            let total: f64 = neighbours.iter().map(|n| n.1).sum();
            let mut row: Vec<f64> = weights[i].iter().map(|w| KEPT * w).collect();
            for &(j, shared) in neighbours {
                let factor = (1.0 - KEPT) * shared / total;
                row.iter_mut().zip(&weights[j as usize]).for_each(|(a, b)| *a += factor * b);
            }
            row
        };
        weights = (0..weights.len()).map(smooth).collect();
    }
    weights.iter().zip(cluster).map(|(row, own)| if own.is_some() { largest(row) } else { Vec::new() }).collect()
}

fn largest(row: &[f64]) -> Vec<(u32, f64)> {
    let mut kept: Vec<(u32, f64)> = (0u32..).zip(row.iter().copied()).filter(|w| w.1 > LEAST).collect();
    kept.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    kept.truncate(MAX_MEMBERSHIPS);
    let total: f64 = kept.iter().map(|w| w.1).sum();
    kept.iter_mut().for_each(|w| w.1 /= total);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_fall_off_across_a_border_and_sum_to_one() {
        let (mut start, mut seen) = (vec![0], Vec::new());
        for p in 0..19 {
            seen.extend([p, p + 1]);
            start.push(seen.len() as u32);
        }
        let covisibility = Covisibility::new(21, &start, &seen);
        let cluster: Vec<Option<u32>> = (0..21).map(|i| (i < 20).then_some(u32::from(i >= 10))).collect();
        let blended = blend(&covisibility, &cluster);
        let first = |i: usize| blended[i].iter().find(|w| w.0 == 0).map_or(0.0, |w| w.1);
        assert!((0..19).all(|i| first(i + 1) <= first(i)));
        assert_eq!((first(0), first(19)), (1.0, 0.0));
        assert!(first(9) > 0.5 && first(9) < 1.0 && first(10) > 0.0 && first(10) < 0.5);
        assert!(blended[..20].iter().all(|row| (row.iter().map(|w| w.1).sum::<f64>() - 1.0).abs() < 1e-12));
        assert!(blended[20].is_empty());
    }
}
