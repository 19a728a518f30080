//! What a solve tells besides its iterations: that it did not run, or did not stay, where it was meant to.

use std::fmt;

/// Something that a person should know about where a solve ran.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Notice {
    /// The device went away in the middle of a solve. The solve went on from the last state that was kept.
    DeviceLost {
        /// What the driver said.
        reason: String,
        /// The new device, or `None` where there was none and the CPU took over.
        resumed_on: Option<String>,
    },
    /// A solve that was meant for the device ran on the CPU. Each reason is given once.
    OnCpu {
        /// The problem.
        what: &'static str,
        /// Why the device did not solve it.
        reason: String,
    },
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::DeviceLost { reason, resumed_on: Some(device) } => {
                write!(f, "the GPU device was lost ({reason}); the solve goes on from its last kept state on {device}")
            }
            Self::DeviceLost { reason, resumed_on: None } => write!(
                f,
                "the GPU device was lost ({reason}) and there is no other; the solve goes on from its last kept state on \
                 the CPU"
            ),
            Self::OnCpu { what, reason } => write!(f, "{what} runs on the CPU: {reason}"),
        }
    }
}
