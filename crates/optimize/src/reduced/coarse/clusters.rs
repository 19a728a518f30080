//! Clusters of images that see the same points: what the coarse space moves as one.

use crate::grouping::group;

/// Points seen by more images than this say little about which images belong together, and cost the square of it
/// (source: `scale.md` §3.1).
const MAX_TRACK: usize = 150;
/// A cluster may hold this many times the mean (source: `scale.md` §3.1).
const MAX_RELATIVE_SIZE: f64 = 1.6;

/// How many points each pair of images shares: rows of (other image, count), both halves of the symmetric matrix.
#[derive(Clone, Debug)]
pub(crate) struct Covisibility {
    rows: Vec<Vec<(u32, f64)>>,
}

impl Covisibility {
    /// `images[track_start[p]..track_start[p + 1]]` saw point `p`.
    pub(crate) fn new(num_images: usize, track_start: &[u32], images: &[u32]) -> Self {
        let point: Vec<u32> =
            track_start.windows(2).enumerate().flat_map(|(p, w)| (w[0]..w[1]).map(move |_| p as u32)).collect();
        let (start, order) = group(images, num_images);
        let mut counts = vec![0u32; num_images];
        let mut met = Vec::new();
        let rows = (0..num_images).map(|i| {
            for &o in &order[start[i] as usize..start[i + 1] as usize] {
                let p = point[o as usize] as usize;
                let track = &images[track_start[p] as usize..track_start[p + 1] as usize];
                if track.len() > MAX_TRACK {
                    continue;
                }
                for &j in track.iter().filter(|&&j| j as usize != i) {
                    if counts[j as usize] == 0 {
                        met.push(j);
                    }
                    counts[j as usize] += 1;
                }
            }
            met.sort_unstable();
            met.drain(..).map(|j| (j, f64::from(std::mem::take(&mut counts[j as usize])))).collect()
        });
        Self { rows: rows.collect() }
    }

    /// The images that share points with one.
    pub(crate) fn row(&self, image: usize) -> &[(u32, f64)] {
        &self.rows[image]
    }

    pub(crate) fn num_images(&self) -> usize {
        self.rows.len()
    }
}

/// The cluster of each image, numbered from 0 by first image; `None` for images that share no point, and for those in
/// small fragments beyond `limit` clusters (the largest are kept).
pub(crate) fn clusters(covisibility: &Covisibility, wanted: usize, limit: usize) -> Vec<Option<u32>> {
    let n = covisibility.num_images();
    let cap = (MAX_RELATIVE_SIZE * n as f64 / wanted.max(1) as f64).ceil() as usize;
    let mut cluster: Vec<u32> = (0..n as u32).collect();
    let mut size = vec![1usize; n];
    let mut left = (0..n).filter(|&i| !covisibility.row(i).is_empty()).count();
    let mut edges: Vec<(u32, u32, f64)> = Vec::new();
    for i in 0..n {
        let later = covisibility.row(i).iter().filter(|e| e.0 as usize > i);
        edges.extend(later.map(|&(j, count)| (i as u32, j, count)));
    }
    while left > wanted {
        let before = left;
        let weight = |e: &(u32, u32, f64)| e.2 / (size[e.0 as usize] * size[e.1 as usize]) as f64;
        let fits = |e: &&(u32, u32, f64)| size[e.0 as usize] + size[e.1 as usize] <= cap;
        let mut ranked: Vec<(f64, u32, u32)> = edges.iter().filter(fits).map(|e| (weight(e), e.0, e.1)).collect();
        ranked.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut into: Vec<u32> = (0..n as u32).collect();
        let mut used = vec![false; n];
        for (_, a, b) in ranked {
            if left > wanted && !used[a as usize] && !used[b as usize] {
                (used[a as usize], used[b as usize]) = (true, true);
                into[b as usize] = a;
                size[a as usize] += size[b as usize];
                left -= 1;
            }
        }
        if left == before {
            break;
        }
        cluster.iter_mut().for_each(|c| *c = into[*c as usize]);
        edges = contracted(edges, &into);
    }
    number(covisibility, &cluster, limit)
}

/// Edges between what is left after merging, each pair once.
fn contracted(mut edges: Vec<(u32, u32, f64)>, into: &[u32]) -> Vec<(u32, u32, f64)> {
    for (a, b, _) in &mut edges {
        let (x, y) = (into[*a as usize], into[*b as usize]);
        (*a, *b) = (x.min(y), x.max(y));
    }
    edges.retain(|e| e.0 != e.1);
    edges.sort_by_key(|e| (e.0, e.1));
    edges.dedup_by(|later, kept| {
        let same = (later.0, later.1) == (kept.0, kept.1);
        if same {
            kept.2 += later.2;
        }
        same
    });
    edges
}

fn number(covisibility: &Covisibility, cluster: &[u32], limit: usize) -> Vec<Option<u32>> {
    let n = cluster.len();
    let linked = |i: &usize| !covisibility.row(*i).is_empty();
    let mut size = vec![0usize; n];
    (0..n).filter(linked).for_each(|i| size[cluster[i] as usize] += 1);
    let mut kept: Vec<u32> = (0..n as u32).filter(|&c| size[c as usize] > 0).collect();
    kept.sort_by_key(|&c| std::cmp::Reverse(size[c as usize]));
    kept.truncate(limit);
    let mut is_kept = vec![false; n];
    kept.iter().for_each(|&c| is_kept[c as usize] = true);
    let mut number = vec![None; n];
    let mut next = 0;
    (0..n)
        .map(|i| {
            let c = cluster[i] as usize;
            if !linked(&i) || !is_kept[c] {
                return None;
            }
            if number[c].is_none() {
                number[c] = Some(next);
                next += 1;
            }
            number[c]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain: point `p` is seen by images `p` and `p + 1`, the more often the nearer to an even `p`.
    fn chain(images: u32) -> (Vec<u32>, Vec<u32>) {
        let (mut start, mut seen) = (vec![0], Vec::new());
        for p in 0..images - 1 {
            for _ in 0..if p % 2 == 0 { 3 } else { 1 } {
                seen.extend([p, p + 1]);
                start.push(seen.len() as u32);
            }
        }
        (start, seen)
    }

    #[test]
    fn a_chain_is_cut_into_runs_of_bounded_size() {
        let (start, seen) = chain(64);
        let covisibility = Covisibility::new(64, &start, &seen);
        assert_eq!(covisibility.row(0), [(1, 3.0)]);
        assert_eq!(covisibility.row(1), [(0, 3.0), (2, 1.0)]);
        let found = clusters(&covisibility, 8, 10);
        let number: Vec<u32> = found.iter().map(|c| c.expect("every image has a neighbour")).collect();
        assert!(number.windows(2).all(|w| w[1] == w[0] || w[1] == w[0] + 1), "{number:?}");
        let most = (0..8).map(|c| number.iter().filter(|&&n| n == c).count()).max();
        assert!(number[63] >= 7 && number[63] <= 9 && most <= Some(13), "{number:?}");
    }

    #[test]
    fn lonely_images_and_small_fragments_have_none() {
        let (mut start, mut seen) = chain(10);
        for p in 0..5 {
            seen.extend([20 + 2 * p, 21 + 2 * p]);
            start.push(seen.len() as u32);
        }
        let found = clusters(&Covisibility::new(31, &start, &seen), 2, 3);
        assert!(found[..10].iter().all(Option::is_some));
        assert!(found[10..20].iter().all(Option::is_none) && found[30].is_none());
        assert!(found.iter().flatten().max() < Some(&3));
    }
}
