//! Parallel loops whose results do not depend on the number of threads, and that run on one thread without rayon.
//!
//! Work is split into pieces fixed by the data alone; each piece writes its own output, and whoever sums outputs does
//! so in the order of the pieces.

use crate::lm::{Observer, breath};

/// `f(index, item)` for every item, each item handled by one thread.
pub(crate) fn for_each_mut<T: Send>(items: &mut [T], f: impl Fn(usize, &mut T) + Sync + Send) {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        items.par_iter_mut().with_max_len(1).enumerate().for_each(|(i, item)| f(i, item));
    }
    #[cfg(not(feature = "rayon"))]
    items.iter_mut().enumerate().for_each(|(i, item)| f(i, item));
}

/// [`for_each_mut`] that lets the host in between items where they run one after the other, in a browser tab.
pub(crate) async fn for_each_mut_breathing<T: Send>(
    items: &mut [T],
    observer: &mut dyn Observer,
    f: impl Fn(usize, &mut T) + Sync + Send,
) {
    if cfg!(feature = "rayon") {
        return for_each_mut(items, f);
    }
    for (i, item) in items.iter_mut().enumerate() {
        f(i, item);
        breath(observer).await;
    }
}

/// [`map_indices`], likewise.
pub(crate) async fn map_indices_breathing<R: Send>(
    count: usize,
    observer: &mut dyn Observer,
    f: impl Fn(usize) -> R + Sync + Send,
) -> Vec<R> {
    if cfg!(feature = "rayon") {
        return map_indices(count, f);
    }
    let mut results = Vec::with_capacity(count);
    for i in 0..count {
        results.push(f(i));
        breath(observer).await;
    }
    results
}

/// `f(index)` for `0..count`, results in order.
pub(crate) fn map_indices<R: Send>(count: usize, f: impl Fn(usize) -> R + Sync + Send) -> Vec<R> {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        (0..count).into_par_iter().with_max_len(1).map(f).collect()
    }
    #[cfg(not(feature = "rayon"))]
    (0..count).map(f).collect()
}

/// Cuts a slice at the given ascending offsets (first 0, last the length) into disjoint mutable pieces.
pub(crate) fn split_mut<'a, T>(mut slice: &'a mut [T], offsets: &[usize]) -> Vec<&'a mut [T]> {
    let mut pieces = Vec::with_capacity(offsets.len().saturating_sub(1));
    for pair in offsets.windows(2) {
        let (piece, rest) = slice.split_at_mut(pair[1] - pair[0]);
        pieces.push(piece);
        slice = rest;
    }
    pieces
}
