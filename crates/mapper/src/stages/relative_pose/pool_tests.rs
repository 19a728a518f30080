//! Helpers that answer late, out of order, wrongly or not at all: the same poses as without any, and nothing left behind.

use std::cell::Cell;
use std::future::poll_fn;
use std::pin::pin;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};

use epipole_geometry::Rigid3;
use epipole_geometry::two_view::{TwoViewConfig, TwoViewGeometry};
use epipole_optimize::executor::block_on;
use epipole_scene::PairConfig;
use glam::{DMat3, DQuat, DVec3};

use super::encoding::{Numbers, answers};
use super::problem::{Problem, Task};
use super::tests::graph;
use super::*;

/// What becomes of the batches that helpers get.
#[derive(Clone, Copy, PartialEq)]
enum Manner {
    /// Each is answered after another number of polls.
    OutOfOrder,
    /// The third and all after it are not.
    Dying,
    /// The answers are cut short.
    Garbled,
    /// None is ever answered.
    Silent,
    /// There are no helpers to begin with.
    Absent,
}

struct Fake {
    manner: Manner,
    batches: usize,
    under_way: Rc<Cell<usize>>,
    most_under_way: usize,
    ended: usize,
}

impl Fake {
    fn new(manner: Manner) -> Self {
        Self { manner, batches: 0, under_way: Rc::default(), most_under_way: 0, ended: 0 }
    }
}

impl PairPool for Fake {
    fn start(&mut self) -> Result<usize, String> {
        if self.manner == Manner::Absent { Err("there are none".into()) } else { Ok(3) }
    }

    fn solve(&mut self, problems: &[f64]) -> Answering {
        self.batches += 1;
        self.under_way.set(self.under_way.get() + 1);
        self.most_under_way = self.most_under_way.max(self.under_way.get());
        let mut answer = match self.manner {
            Manner::Dying if self.batches > 2 => Err("it died".to_owned()),
            _ => Ok(solve_pairs(problems).expect("a batch")),
        };
        if let (Manner::Garbled, Ok(numbers)) = (self.manner, &mut answer) {
            numbers.pop();
        }
        let silent = self.manner == Manner::Silent;
        let (mut polls, under_way) = (7 * self.batches % 5, self.under_way.clone());
        Box::pin(poll_fn(move |_| {
            if silent || polls > 0 {
                polls = polls.saturating_sub(1);
                return Poll::Pending;
            }
            under_way.set(under_way.get() - 1);
            Poll::Ready(answer.clone())
        }))
    }

    fn end(&mut self) {
        self.ended += 1;
    }
}

/// A clock that goes on whenever it is looked at, and a person who stops after so many words of progress.
struct Watch {
    seconds: Cell<f64>,
    tick_seconds: f64,
    warnings: Vec<String>,
    progress: Vec<usize>,
    stop_after: usize,
}

impl Watch {
    fn new() -> Self {
        let (warnings, progress) = (Vec::new(), Vec::new());
        Self { seconds: Cell::new(0.0), tick_seconds: 0.02, warnings, progress, stop_after: usize::MAX }
    }
}

impl Observer for Watch {
    fn event(&mut self, event: &Event) {
        match event {
            Event::Warning { message } => self.warnings.push(message.clone()),
            Event::Progress { done, .. } => self.progress.push(*done),
            _ => {}
        }
    }

    fn should_stop(&self) -> bool {
        self.progress.len() >= self.stop_after
    }

    fn now_seconds(&self) -> f64 {
        self.seconds.set(self.seconds.get() + self.tick_seconds);
        self.seconds.get()
    }
}

/// Stored, weak and hopeless pairs among those that have to be solved, and matches of keypoints that do not exist.
fn mixed() -> ViewGraph {
    let (mut graph, _) = graph(9, 12);
    graph.pairs[3].cam2_from_cam1 = Some(Rigid3::new(DQuat::from_rotation_z(0.5), DVec3::X));
    graph.pairs[5].config = PairConfig::Watermark;
    graph.pairs[20].essential = Some(DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0)));
    for pair in &mut graph.pairs[8..10] {
        pair.inliers.iter_mut().chain(pair.matches.iter_mut().flatten()).for_each(|m| m[1] = (m[0] * 37 + 11) % 120);
    }
    for pair in &mut graph.pairs[10..14] {
        pair.inliers.iter_mut().chain(pair.matches.iter_mut().flatten()).step_by(17).for_each(|m| m[1] = 4_000_000);
    }
    graph
}

type Left = Vec<(usize, usize, Option<Rigid3>, PairConfig, Vec<[u32; 2]>, Option<DMat3>)>;

fn solved(
    matches: Matches,
    pool: Option<&mut dyn PairPool>,
    watch: &mut Watch,
) -> (Result<Summary, MapperError>, Left) {
    let mut graph = mixed();
    let summary = block_on(run(&mut graph, &Options::default(), matches, 7, pool, watch));
    let left = graph.pairs.into_iter();
    (summary, left.map(|p| (p.image1, p.image2, p.cam2_from_cam1, p.config, p.inliers, p.essential)).collect())
}

#[test]
fn whoever_solves_a_pair_finds_the_same() {
    for matches in [Matches::Verified, Matches::Raw] {
        let (alone, expected) = solved(matches, None, &mut Watch::new());
        let alone = alone.unwrap();
        assert!(expected.len() > 25 && alone.without_pose + alone.weak > 0, "{alone}");
        for manner in [Manner::OutOfOrder, Manner::Dying, Manner::Garbled, Manner::Absent] {
            let (mut pool, mut watch) = (Fake::new(manner), Watch::new());
            let (summary, found) = solved(matches, Some(&mut pool), &mut watch);
            assert!(found == expected, "poses differ");
            let helpers = if manner == Manner::Absent { 0 } else { 3 };
            assert_eq!(summary.unwrap(), Summary { helpers, ..alone });
            assert_eq!((pool.ended, pool.batches > 2), (1, helpers > 0));
            assert!(pool.most_under_way <= 6, "{} batches under way", pool.most_under_way);
            assert!(watch.progress.is_sorted() && watch.progress.last() == Some(&36), "{:?}", watch.progress);
            let why = match manner {
                Manner::Dying => "it died",
                Manner::Garbled => "its answer is none",
                _ => "there are none",
            };
            match manner {
                Manner::OutOfOrder => assert!(watch.warnings.is_empty(), "{:?}", watch.warnings),
                _ => assert!(matches!(&watch.warnings[..], [one] if one.contains(why)), "{:?}", watch.warnings),
            }
        }
    }
}

#[test]
fn little_work_needs_no_helpers() {
    let (mut pool, mut watch) = (Fake::new(Manner::OutOfOrder), Watch { tick_seconds: 1e-4, ..Watch::new() });
    let (summary, _) = solved(Matches::Verified, Some(&mut pool), &mut watch);
    assert_eq!((summary.unwrap().helpers, pool.batches, pool.ended), (0, 0, 0));
}

#[test]
fn stopping_and_giving_up_end_the_helpers() {
    let (mut pool, mut watch) = (Fake::new(Manner::OutOfOrder), Watch { stop_after: 9, ..Watch::new() });
    let (summary, _) = solved(Matches::Verified, Some(&mut pool), &mut watch);
    assert!(matches!(summary, Err(MapperError::Stopped)));
    assert!(pool.ended == 1 && pool.under_way.get() > 0);

    // A run that waits for an answer which does not come, dropped as a cancelled one is.
    let (mut graph, options, mut pool, mut watch) =
        (mixed(), Options::default(), Fake::new(Manner::Silent), Watch::new());
    {
        let mut waiting = pin!(run(&mut graph, &options, Matches::Verified, 7, Some(&mut pool), &mut watch));
        for _ in 0..100 {
            assert!(waiting.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending());
        }
    }
    assert_eq!((pool.batches, pool.ended), (6, 1));
}

/// Numbers that lose something in any shorter way of writing.
fn awkward(k: usize) -> f64 {
    [-0.0, f64::MIN_POSITIVE / 8.0, f64::MAX, 1.0 + f64::EPSILON, 0.1, -1e-300][k % 6]
}

#[test]
fn problems_and_answers_survive_as_numbers() {
    let matrix =
        |k: usize| (!k.is_multiple_of(3)).then(|| DMat3::from_cols_array(&std::array::from_fn(|i| awkward(i + k))));
    let mut camera = graph(2, 0).0.cameras.remove(0);
    camera.params[0] += f64::EPSILON * 1024.0;
    let mut written = Vec::new();
    let problems: Vec<Problem> = (0..40)
        .map(|k| Problem {
            task: TwoViewConfig::ALL.get(k).map_or(Task::Raw { min_inliers: k }, |&config| Task::Verified(config)),
            matrices: [matrix(k), matrix(k + 1), matrix(k + 2)],
            cameras: [camera.clone(), Camera { id: k as u32, has_prior_focal: k.is_multiple_of(2), ..camera.clone() }],
            points_px: [3, 5].map(|step| (0..k).map(|i| (awkward(i), awkward(step * i)).into()).collect()),
            max_error_px: awkward(k),
            enough: awkward(k + 1),
            seed: u64::MAX - k as u64,
        })
        .collect();
    problems.iter().for_each(|problem| problem.write(&mut written));
    let bits = |numbers: &[f64]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    let mut numbers = Numbers(&written);
    for problem in &problems {
        let read = Problem::read(&mut numbers).unwrap();
        let mut again = [Vec::new(), Vec::new()];
        problem.write(&mut again[0]);
        read.write(&mut again[1]);
        assert_eq!(&read, problem);
        assert_eq!(bits(&again[0]), bits(&again[1]));
    }
    assert!(numbers.0.is_empty());

    let pose = Rigid3 { rotation: DQuat::from_array([0.1, 0.2, 0.3, 0.9]), translation: DVec3::new(0.1, -0.0, 1e-310) };
    let verified = |k: usize| {
        Found::Verified(Box::new(TwoViewGeometry {
            config: TwoViewConfig::ALL[k],
            essential: matrix(k),
            fundamental: matrix(k + 1),
            homography: matrix(k + 2),
            cam2_from_cam1: k.is_multiple_of(2).then_some(pose),
            inliers: vec![0, 7, u32::MAX],
            tri_angle_rad: awkward(k),
        }))
    };
    let mut found: Vec<Found> = (0..10).map(verified).collect();
    found.extend([PoseSource::Stored, PoseSource::Estimated].map(|source| Found::Pose(pose, source)));
    found.extend([Found::Stored, Found::Weak, Found::WithoutPose]);
    let mut written = Vec::new();
    found.iter().for_each(|found| found.write(&mut written));
    let read = answers(&written, found.len()).unwrap();
    let mut again = Vec::new();
    read.iter().for_each(|found| found.write(&mut again));
    assert_eq!(read, found);
    assert_eq!(bits(&again), bits(&written));
    // Whatever is missing is noticed.
    let whole = (0..=written.len()).filter(|&n| answers(&written[..n], found.len()).is_some());
    assert_eq!(whole.collect::<Vec<_>>(), [written.len()]);
    assert!(answers(&[9.0], 1).is_none() && answers(&[5.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e300], 1).is_none());
    assert!(solve_pairs(&[-1.0, 15.0, 1.0]).is_none());
}
