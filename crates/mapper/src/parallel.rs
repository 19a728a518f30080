//! Parallel maps that give the same result on any number of threads, and run on one where there is no rayon.

use crate::event::{Observer, breath};

/// `f` of every item, in order.
pub(crate) fn map<T: Sync, R: Send>(items: &[T], f: impl Fn(usize, &T) -> R + Sync + Send) -> Vec<R> {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        items.par_iter().enumerate().map(|(i, item)| f(i, item)).collect()
    }
    #[cfg(not(feature = "rayon"))]
    {
        items.iter().enumerate().map(|(i, item)| f(i, item)).collect()
    }
}

/// [`map`] that lets the host in between items where they run one after the other, and ends early where it asks to stop:
/// then there are fewer results than items.
pub(crate) async fn map_breathing<T: Sync, R: Send>(
    items: &[T],
    observer: &mut dyn Observer,
    f: impl Fn(usize, &T) -> R + Sync + Send,
) -> Vec<R> {
    breath(observer).await;
    if cfg!(feature = "rayon") {
        return map(items, f);
    }
    let mut results = Vec::with_capacity(items.len());
    for (i, item) in items.iter().enumerate() {
        if observer.should_stop() {
            break;
        }
        results.push(f(i, item));
        breath(observer).await;
    }
    results
}

/// `f` of every item in place.
pub(crate) fn for_each_mut<T: Send>(items: &mut [T], f: impl Fn(usize, &mut T) + Sync + Send) {
    #[cfg(feature = "rayon")]
    {
        use rayon::prelude::*;
        items.par_iter_mut().enumerate().for_each(|(i, item)| f(i, item));
    }
    #[cfg(not(feature = "rayon"))]
    {
        items.iter_mut().enumerate().for_each(|(i, item)| f(i, item));
    }
}
