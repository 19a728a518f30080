//! Helpers that solve pairs beside whoever runs the pipeline: how a browser tab, where there are no threads, uses more than one
//! processor. Who answers, in which order and whether at all changes nothing in the result.

use std::future::poll_fn;
use std::pin::Pin;
use std::task::Poll;

use super::encoding::answers;
use super::work::Work;
use crate::error::MapperError;
use crate::event::{Event, Observer, breath};

/// One batch is solved and one waits, so that no helper does.
const BATCHES_PER_HELPER: usize = 2;

/// What a helper answers, or why it does not.
pub type Answering = Pin<Box<dyn Future<Output = Result<Vec<f64>, String>>>>;

/// Helpers, as the host has them.
pub trait PairPool {
    /// Starts them; their number, 0 where they would be of no use.
    ///
    /// # Errors
    /// Why there can be none.
    fn start(&mut self) -> Result<usize, String>;

    /// Gives them a batch, of which [`super::solve_pairs`] makes the answer.
    fn solve(&mut self, problems: &[f64]) -> Answering;

    /// Ends them and gives their memory back. Whatever they have not answered is not wanted any more.
    fn end(&mut self);
}

/// Helpers that end with whoever started them, also where a run is given up.
struct Helpers<'a>(&'a mut dyn PairPool);

impl Drop for Helpers<'_> {
    fn drop(&mut self) {
        self.0.end();
    }
}

/// Gives helpers what waits, in batches of at most so many pairs. What they do not answer waits again afterwards, with a warning.
/// The number of helpers.
pub(super) async fn share(
    work: &mut Work<'_>,
    pairs_per_batch: usize,
    pool: &mut dyn PairPool,
    observer: &mut dyn Observer,
) -> Result<usize, MapperError> {
    let helpers = Helpers(pool);
    let (started, mut failure) = match helpers.0.start() {
        Ok(started) => (started, None),
        Err(why) => (0, Some(why)),
    };
    let mut living = started;
    let mut unanswered = Vec::new();
    let mut under_way: Vec<(Vec<usize>, Answering)> = Vec::new();
    loop {
        while under_way.len() < BATCHES_PER_HELPER * living {
            // Smaller towards the end, so that the helpers end together.
            let fair = work.waiting.len().div_ceil(BATCHES_PER_HELPER * living);
            let Some((pairs, problems)) = work.batch(pairs_per_batch.clamp(1, fair.max(1))) else { break };
            under_way.push((pairs, helpers.0.solve(&problems)));
        }
        if under_way.is_empty() {
            break;
        }
        let (k, answer) = first_answer(&mut under_way, observer).await.ok_or(MapperError::Stopped)?;
        let (pairs, _) = under_way.swap_remove(k);
        // Before anything is told of it: a person may have paused.
        breath(observer).await;
        let found = answer.and_then(|numbers| answers(&numbers, pairs.len()).ok_or("its answer is none".into()));
        match found {
            Ok(found) => {
                work.settle(pairs, found);
                observer.event(&work.progress());
            }
            Err(why) => {
                living = living.saturating_sub(1);
                failure.get_or_insert(why);
                unanswered.extend(pairs);
            }
        }
    }
    if let Some(why) = failure {
        let pairs = unanswered.len() + work.waiting.len();
        let message = format!("helpers left {pairs} pairs, which are solved without them: {why}");
        observer.event(&Event::Warning { message });
    }
    work.waiting.extend(unanswered);
    Ok(started)
}

/// The first batch that is answered, by its place; `None` as soon as a person wants to stop, for which no message need come: a
/// host that hears the wish polls the run.
async fn first_answer(
    under_way: &mut [(Vec<usize>, Answering)],
    observer: &dyn Observer,
) -> Option<(usize, Result<Vec<f64>, String>)> {
    poll_fn(|context| {
        if observer.should_stop() {
            return Poll::Ready(None);
        }
        for (k, (_, answer)) in under_way.iter_mut().enumerate() {
            if let Poll::Ready(answer) = answer.as_mut().poll(context) {
                return Poll::Ready(Some((k, answer)));
            }
        }
        Poll::Pending
    })
    .await
}
