//! Hands a device its work in turns, so that whoever watches a solve gets in between: what is queued cannot be taken back.

use std::cell::Cell;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Poll, Waker};

use super::device::Device;
use super::error::GpuError;
use crate::error::OptimizeError;
use crate::lm::{Observer, breath};

/// Observations times kernels in one turn of a hardware adapter: at 20 bytes each and the 20 GB/s of a slow one 0.1 s. The
/// wait at the end of a turn takes a millisecond or two, so that turns cost two per cent of the time.
const WORK_PER_TURN: usize = 100_000_000;

/// Why a solve ends between two kernels.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Halt {
    /// The observer asked to stop; the accepted state stands.
    Stopped,
    /// The device failed.
    Failed(GpuError),
}

impl From<GpuError> for Halt {
    fn from(error: GpuError) -> Self {
        Self::Failed(error)
    }
}

impl From<Halt> for OptimizeError {
    fn from(halt: Halt) -> Self {
        match halt {
            Halt::Stopped => Self::Stopped,
            Halt::Failed(error) => error.into(),
        }
    }
}

/// What was handed out since the device was last waited for.
#[derive(Debug, Default)]
pub(crate) struct Turns {
    work: Cell<usize>,
    taken: Cell<u64>,
}

impl Turns {
    /// Submissions made by turns.
    pub(crate) fn taken(&self) -> u64 {
        self.taken.get()
    }

    /// Called after kernels over `observations` observations in all have been recorded: where that is a turn's worth (on a software
    /// adapter every kernel is), submits them, waits for the device and lets the observer breathe.
    ///
    /// Nothing happens where nobody interrupts the solve: then the host is never waited for.
    pub(crate) async fn rest(
        &self,
        device: &Device,
        encoder: &mut wgpu::CommandEncoder,
        observations: usize,
        observer: &mut dyn Observer,
    ) -> Result<(), GpuError> {
        if !observer.interrupts() {
            return Ok(());
        }
        self.work.set(self.work.get().saturating_add(observations));
        if !device.is_software() && self.work.get() < WORK_PER_TURN {
            return Ok(());
        }
        self.work.set(0);
        self.taken.set(self.taken.get() + 1);
        device.submit(std::mem::replace(encoder, device.encoder()));
        device.settle(observer).await?;
        breath(observer).await;
        Ok(())
    }

    /// [`Self::rest`], after which the solve ends if the observer wants it to.
    pub(crate) async fn take(
        &self,
        device: &Device,
        encoder: &mut wgpu::CommandEncoder,
        observations: usize,
        observer: &mut dyn Observer,
    ) -> Result<(), Halt> {
        self.rest(device, encoder, observations, observer).await?;
        if observer.interrupts() && observer.should_stop() { Err(Halt::Stopped) } else { Ok(()) }
    }
}

impl Device {
    /// Waits until everything that was submitted is done; no longer than until the observer wants to stop, as long as that may be:
    /// a browser compiles a kernel when it first runs.
    pub(crate) async fn settle(&self, observer: &mut dyn Observer) -> Result<(), GpuError> {
        #[derive(Default)]
        struct Done {
            is_done: bool,
            waker: Option<Waker>,
        }
        let done = Arc::new(Mutex::new(Done::default()));
        let setter = done.clone();
        self.queue.on_submitted_work_done(move || {
            let mut done = setter.lock().unwrap_or_else(PoisonError::into_inner);
            done.is_done = true;
            if let Some(waker) = done.waker.take() {
                waker.wake();
            }
        });
        self.wait()?;
        std::future::poll_fn(|context| {
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            if done.is_done || observer.should_stop() {
                return Poll::Ready(());
            }
            done.waker = Some(context.waker().clone());
            Poll::Pending
        })
        .await;
        observer.heard();
        self.check()
    }
}
