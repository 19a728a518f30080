//! Subtracting the eliminated points from the reduced matrix.

use super::incidence::{Incidence, Member};
use super::kernel::{Vectorized, dispatch, subtract_fixed, subtract_product};
use super::matrix::BlockMatrix;
use super::pattern::BlockPattern;
use crate::lm::{Observer, breath};
use crate::parallel;

/// Participants whose factors are held at once: with 6 unknowns a block, 6 MB, which stays near the cores.
const CHUNK_PARTICIPANTS: usize = 32 * 1024;
/// Beyond this many passes over the matrix its own traffic would cost more than the factors' does.
const MAX_CHUNKS: usize = 24;
/// Points whose factors one thread fills at a time.
const FILL_POINTS: usize = 256;
/// No slot for this column in the current row.
const ABSENT: u32 = u32::MAX;

/// A 3-vector of each point. Behind a pointer: it is asked for once a participant, and the unrolled loops around it are large.
type PointVector<'a> = dyn Fn(usize) -> [f64; 3] + Sync + Send + 'a;

impl BlockMatrix {
    /// `A −= Σ_points E Eᵀ`. `fill(point, factors)` writes, for each participant of the point in order, `Eᵀ`: 3 rows of
    /// [`super::BlockLayout::factor_stride`] scalars, of which the first `size` count (the buffer comes zeroed, padding
    /// must stay zero). Only blocks in the pattern are formed.
    pub async fn subtract_points(
        &mut self,
        incidence: &Incidence,
        fill: impl Fn(usize, &mut [f64]) + Sync + Send,
        observer: &mut dyn Observer,
    ) {
        self.eliminate_points(incidence, fill, |_| [0.0; 3], &mut [], observer).await;
    }

    /// As [`Self::subtract_points`], and `rhs += Σ_points E z`: with `z = R⁻ᵀ g` for the gradient `g` of a point this is
    /// what its elimination does to the right-hand side, for next to nothing while its factors are at hand. An empty
    /// `rhs` is left alone. Breathes between chunks of points; a solve that is to stop gets a matrix of no use.
    pub async fn eliminate_points(
        &mut self,
        incidence: &Incidence,
        fill: impl Fn(usize, &mut [f64]) + Sync + Send,
        z: impl Fn(usize) -> [f64; 3] + Sync + Send,
        rhs: &mut [f64],
        observer: &mut dyn Observer,
    ) {
        let pattern = self.pattern().clone();
        let participant_len = 3 * pattern.layout().factor_stride();
        if participant_len == 0 {
            return;
        }
        let chunk_len = CHUNK_PARTICIPANTS.max(incidence.num_participants() / MAX_CHUNKS);
        let mut first = 0;
        while first < incidence.num_points() {
            let start = incidence.participants(first).start;
            let mut last = first + 1;
            while last < incidence.num_points() && incidence.participants(last).end - start <= chunk_len {
                last += 1;
            }
            let end = incidence.participants(last - 1).end;
            let len = (end - start) * participant_len;
            if self.factors.len() < len {
                self.factors.resize(len, 0.0);
            }
            let factors = &mut self.factors[..len];
            fill_factors(incidence, first..last, factors, participant_len, &fill);
            subtract_chunk(&pattern, &mut self.values, rhs, incidence, start..end, factors, &z);
            first = last;
            breath(observer).await;
            if observer.should_stop() {
                return;
            }
        }
    }
}

fn fill_factors(
    incidence: &Incidence,
    points: std::ops::Range<usize>,
    factors: &mut [f64],
    participant_len: usize,
    fill: &(impl Fn(usize, &mut [f64]) + Sync + Send),
) {
    let start = incidence.participants(points.start).start;
    let groups: Vec<usize> = points.clone().step_by(FILL_POINTS).chain([points.end]).collect();
    let offset = |point: usize| match point == points.end {
        true => factors.len(),
        false => (incidence.participants(point).start - start) * participant_len,
    };
    let offsets: Vec<usize> = groups.iter().map(|&p| offset(p)).collect();
    let mut pieces = parallel::split_mut(factors, &offsets);
    parallel::for_each_mut(&mut pieces, |g, piece| {
        let base = incidence.participants(groups[g]).start;
        for point in groups[g]..groups[g + 1] {
            let range = incidence.participants(point);
            let piece = &mut piece[(range.start - base) * participant_len..(range.end - base) * participant_len];
            piece.fill(0.0);
            fill(point, piece);
        }
    });
}

fn subtract_chunk(
    pattern: &BlockPattern,
    values: &mut [f64],
    rhs: &mut [f64],
    incidence: &Incidence,
    participants: std::ops::Range<usize>,
    factors: &[f64],
    z: &PointVector<'_>,
) {
    let blocks = pattern.layout().num_blocks();
    let offsets: Vec<usize> =
        (0..blocks).map(|i| pattern.value_offset(pattern.row(i).start)).chain([pattern.num_values()]).collect();
    let with_rhs = !rhs.is_empty();
    let rhs_offsets: Vec<usize> =
        (0..=blocks).map(|i| if with_rhs { pattern.layout().range_start(i) } else { 0 }).collect();
    let rows = parallel::split_mut(values, &offsets);
    let mut rows: Vec<_> = rows.into_iter().zip(parallel::split_mut(rhs, &rhs_offsets)).collect();
    parallel::for_each_mut(&mut rows, |i, (values, rhs)| {
        let members = incidence.of_block(i);
        let begin = members.partition_point(|m| (m.participant as usize) < participants.start);
        let end = members.partition_point(|m| (m.participant as usize) < participants.end);
        if begin < end {
            dispatch(Row {
                pattern,
                incidence,
                members: &members[begin..end],
                base: participants.start,
                factors,
                i,
                values,
                rhs,
                z,
            });
        }
    });
}

struct Row<'a> {
    pattern: &'a BlockPattern,
    incidence: &'a Incidence,
    members: &'a [Member],
    base: usize,
    factors: &'a [f64],
    i: usize,
    values: &'a mut [f64],
    /// Empty where no right-hand side is wanted.
    rhs: &'a mut [f64],
    z: &'a PointVector<'a>,
}

impl Vectorized for Row<'_> {
    #[inline(always)]
    fn run<const FMA: bool>(mut self) {
        let layout = self.pattern.layout();
        let (rows, pitch) = (layout.size(self.i), layout.factor_stride());
        self.add_to_rhs(rows, pitch);
        let slots = self.pattern.row(self.i);
        let row_start = self.pattern.value_offset(slots.start);
        if slots.len() == 1 {
            let stride = layout.stride(self.i);
            for member in self.members {
                let e = &self.factors[(member.participant as usize - self.base) * 3 * pitch..][..3 * pitch];
                subtract_product::<FMA>(rows, stride, e, e, pitch, self.values);
            }
            return;
        }
        // Offset and stride of each block column in this row.
        let mut place = vec![(ABSENT, 0u32); layout.num_blocks() - self.i];
        for slot in slots {
            let j = self.pattern.column(slot);
            place[j - self.i] = ((self.pattern.value_offset(slot) - row_start) as u32, layout.stride(j) as u32);
        }
        // The shapes that real problems have, with all lengths known to the compiler.
        match (rows, pitch) {
            (6, 8) => self.fixed::<FMA, 6, 8, 24>(&place),
            (3, 4) => self.fixed::<FMA, 3, 4, 12>(&place),
            (9, 12) => self.fixed::<FMA, 9, 12, 36>(&place),
            (7, 8) => self.fixed::<FMA, 7, 8, 24>(&place),
            (8, 8) => self.fixed::<FMA, 8, 8, 24>(&place),
            _ => self.any::<FMA>(&place, rows, pitch),
        }
    }
}

impl Row<'_> {
    #[inline(always)]
    fn add_to_rhs(&mut self, rows: usize, pitch: usize) {
        if self.rhs.is_empty() {
            return;
        }
        for member in self.members {
            let e = &self.factors[(member.participant as usize - self.base) * 3 * pitch..][..3 * pitch];
            let z = (self.z)(member.point as usize);
            for (k, sum) in self.rhs[..rows].iter_mut().enumerate() {
                *sum += e[k] * z[0] + e[pitch + k] * z[1] + e[2 * pitch + k] * z[2];
            }
        }
    }

    /// `LEN` is `3 · PITCH`.
    #[inline(always)]
    fn fixed<const FMA: bool, const ROWS: usize, const PITCH: usize, const LEN: usize>(self, place: &[(u32, u32)]) {
        let (factors, _) = self.factors.as_chunks::<LEN>();
        for member in self.members {
            let (from, to) = (member.participant as usize, member.end as usize);
            let e = &factors[from - self.base];
            let blocks = self.incidence.block_range(from..to);
            for (&block, f) in blocks.iter().zip(&factors[from - self.base..to - self.base]) {
                let (at, stride) = place[block as usize - self.i];
                if stride as usize == PITCH {
                    subtract_fixed::<FMA, ROWS, PITCH, PITCH, LEN>(e, f, &mut self.values[at as usize..]);
                } else if at != ABSENT {
                    subtract_product::<FMA>(ROWS, stride as usize, e, f, PITCH, &mut self.values[at as usize..]);
                }
            }
        }
    }

    #[inline(always)]
    fn any<const FMA: bool>(self, place: &[(u32, u32)], rows: usize, pitch: usize) {
        for member in self.members {
            let (from, to) = (member.participant as usize, member.end as usize);
            let e = &self.factors[(from - self.base) * 3 * pitch..][..3 * pitch];
            for other in from..to {
                let (at, stride) = place[self.incidence.block(other) - self.i];
                if at == ABSENT {
                    continue;
                }
                let f = &self.factors[(other - self.base) * 3 * pitch..][..3 * pitch];
                subtract_product::<FMA>(rows, stride as usize, e, f, pitch, &mut self.values[at as usize..]);
            }
        }
    }
}
