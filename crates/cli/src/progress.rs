//! Showing events: bars on a terminal, plain lines elsewhere, JSON lines for programs.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use epipole_mapper::{Event, Observer, Stage};
use indicatif::{ProgressBar, ProgressStyle};

use crate::{interrupt, output};

/// Redraws of a bar without news, so that a person sees that it lives.
const TICK: Duration = Duration::from_millis(200);

/// Shows events as they come.
pub(crate) struct Progress {
    view: View,
    start: Instant,
}

enum View {
    Json,
    Plain,
    Bars(Option<ProgressBar>),
}

impl Progress {
    /// JSON if asked for, bars if a person is watching, plain lines otherwise.
    pub(crate) fn new(json: bool) -> Self {
        let view = match (json, std::io::stderr().is_terminal()) {
            (true, _) => View::Json,
            (false, true) => View::Bars(None),
            (false, false) => View::Plain,
        };
        Self { view, start: Instant::now() }
    }

    /// A line for people; programs get events.
    pub(crate) fn say(&self, text: &str) {
        match &self.view {
            View::Json => {}
            View::Bars(Some(bar)) => bar.suspend(|| eprintln!("{text}")),
            View::Plain | View::Bars(None) => eprintln!("{text}"),
        }
    }
}

fn title(stage: Stage, component: usize) -> String {
    match component {
        0 => stage.name().to_owned(),
        n => format!("{} ({n})", stage.name()),
    }
}

impl Observer for Progress {
    fn event(&mut self, event: &Event) {
        if let View::Json = self.view {
            return output::json_line(event);
        }
        match event {
            Event::StageStarted { stage, component } => {
                if let View::Bars(bar) = &mut self.view {
                    *bar = Some(new_bar(title(*stage, *component)));
                }
            }
            Event::Progress { done, total, .. } => {
                if let View::Bars(Some(bar)) = &self.view {
                    bar.set_length(*total as u64);
                    bar.set_position(*done as u64);
                }
            }
            Event::Iteration { iteration, cost, .. } => {
                if let View::Bars(Some(bar)) = &self.view {
                    bar.set_message(format!("iteration {iteration}, cost {cost:.6e}"));
                }
            }
            Event::StageFinished { stage, component, seconds, summary } => {
                if let View::Bars(bar) = &mut self.view
                    && let Some(bar) = bar.take()
                {
                    bar.finish_and_clear();
                }
                self.say(&format!("{:<24} {seconds:>8.2} s  {summary}", title(*stage, *component)));
            }
            Event::Warning { message } | Event::DeviceLost { message, .. } => self.say(&format!("warning: {message}")),
            Event::ComponentFinished { component, images, points } => {
                self.say(&format!("component {component}: {images} images, {points} points"));
            }
        }
    }

    fn should_stop(&self) -> bool {
        interrupt::requested()
    }

    fn now_seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}

fn new_bar(title: String) -> ProgressBar {
    let bar = ProgressBar::new(0).with_prefix(title);
    if let Ok(style) = ProgressStyle::with_template("{spinner} {prefix:<24} [{bar:30}] {pos}/{len} {msg}") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(TICK);
    bar
}
