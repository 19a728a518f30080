//! Twin of `row.wgsl` and `model.wgsl`: one observation.

use super::super::records::Stage;
use super::state::State;
use crate::bundle::gpu::twin::num::{Num, Vec3, dot, scale, sub};

/// `A = scale (I − direction directionᵀ)`; no direction where the scale is held.
#[derive(Clone, Copy)]
pub(super) struct Row<N> {
    pub(super) direction: Option<Vec3<N>>,
    pub(super) scale: N,
}

impl<N: Num> Row<N> {
    pub(super) fn root(&self, e: Vec3<N>) -> Vec3<N> {
        scale(self.across(e), self.scale)
    }

    pub(super) fn block(&self, e: Vec3<N>) -> Vec3<N> {
        scale(self.across(e), self.scale * self.scale)
    }

    /// What is kept between kernels.
    pub(super) fn kept(&self) -> N {
        if self.direction.is_some() { self.scale } else { -self.scale }
    }

    fn across(&self, e: Vec3<N>) -> Vec3<N> {
        self.direction.map_or(e, |n| sub(e, scale(n, dot(&n, &e))))
    }
}

pub(super) struct Linear<N> {
    pub(super) row: Row<N>,
    pub(super) gradient: Vec3<N>,
    pub(super) cost: N,
    pub(super) pulls: bool,
}

fn held<N: Num>(v: Vec3<N>, weight: N, s: N, d: Vec3<N>, huber: N) -> Linear<N> {
    let u = sub(v, scale(d, s));
    let square = dot(&u, &u);
    let beyond = square.value() > huber.value() * huber.value();
    let w = if beyond { weight * (huber / square.root()) } else { weight };
    let rho = if beyond { huber * (N::of(2.0) * square.root() - huber) } else { square };
    Linear {
        row: Row { direction: None, scale: w.root() * s },
        gradient: scale(u, -(w * s)),
        cost: N::of(0.5) * weight * rho,
        pulls: true,
    }
}

/// Direction of a stored ray, and its share of its camera's ω.
pub(super) fn ray_of<N: Num>([x, y, z, pin]: [N; 4]) -> (Vec3<N>, N) {
    if pin.value() > 0.0 {
        let share = dot(&[x, y, z], &[x, y, z]).root();
        return ([x / share, y / share, z / share], share);
    }
    ([x, y, z], N::of(1.0))
}

fn masked<N: Num>(cost: N) -> Linear<N> {
    let zero = N::of(0.0);
    Linear { row: Row { direction: None, scale: zero }, gradient: [zero; 3], cost, pulls: false }
}

impl<N: Num> State<N> {
    pub(super) fn linear(&self, ray: [N; 4], weight: N, d: Vec3<N>) -> Linear<N> {
        let (settings, pin) = (&self.settings, ray[3]);
        let of = N::of;
        if pin.value() < 0.0 {
            return masked(of(0.0));
        }
        let (v, share) = ray_of(ray);
        let weight = weight * share;
        let along = dot(&v, &d);
        if settings.stage == Stage::Lud {
            let free = pin.value() == 0.0 && along.value() > f64::from(settings.bound);
            let bound = if free { along } else { of(settings.bound) };
            let length = if pin.value() > 0.0 { of(1.0) / pin } else { bound };
            let r = sub(d, scale(v, length));
            let size = dot(&r, &r).root();
            let floor = if size.value() > f64::from(settings.delta) { size } else { of(settings.delta) };
            let w = weight / floor;
            let row = Row { direction: free.then_some(v), scale: w.root() };
            return Linear { row, gradient: scale(r, w), cost: weight * size, pulls: true };
        }
        if pin.value() > 0.0 {
            return held(v, weight, pin, d, of(settings.huber_pinned));
        }
        if settings.stage == Stage::EqualScales {
            return held(v, weight, of(settings.bound), d, of(settings.huber));
        }
        let (least, square) = (self.vectors[3][0], dot(&d, &d));
        let s = along / square;
        if s.value() > least.value() {
            let mut out = held(v, weight, s, d, of(settings.huber));
            out.row.direction = Some(scale(d, of(1.0) / square.root()));
            return out;
        }
        masked(held(v, weight, least, d, of(settings.huber)).cost)
    }

    /// The row of an observation from what was kept.
    pub(super) fn row(&self, kept: N, d: Vec3<N>, ray: [N; 4]) -> Row<N> {
        if kept.value() <= 0.0 {
            return Row { direction: None, scale: -kept };
        }
        let direction = match self.settings.stage {
            Stage::Lud => [ray[0], ray[1], ray[2]],
            _ => scale(d, N::of(1.0) / dot(&d, &d).root()),
        };
        Row { direction: Some(direction), scale: kept }
    }
}
