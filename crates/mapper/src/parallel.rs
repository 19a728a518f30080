//! Parallel maps that give the same result on any number of threads, and run on one where there is no rayon.

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
