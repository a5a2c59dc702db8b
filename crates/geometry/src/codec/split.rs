//! Coding of one vertex split: the faces that move to the new vertex, the new faces, position, wedges.

use crate::codec::chunk_coder::ChunkCoder;
use crate::codec::fan::{Fan, StarFace};
use crate::codec::model::{CUT, EXTRA_IN_RING, EXTRAS, LABEL, LONG_RUN, MAX_VALENCE, RUN_LENGTH, SINGLE_RUN};
use crate::codec::moves::GridOwner;
use crate::codec::plan::SplitFace;
use crate::codec::position::Roles;
use crate::codec::scratch::{AddedFace, Cut, Scratch, Split};
use crate::codec::skin::{ExpectedSkin, code_skin};
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::{index, integer, tree, tree_contexts};
use crate::error::DecodeError;
use crate::numbers::id32;

/// Most new faces per split beyond the usual two.
const MAX_EXTRAS: u32 = 1 << 16;

impl<C: Coder> ChunkCoder<'_, '_, C> {
    /// Codes the split of `t`; returns the new vertex.
    pub(crate) fn split(&mut self, t: u32) -> Result<u32, DecodeError> {
        let new_faces = self.guide.as_mut().map_or_else(Vec::new, |g| g.begin_split(t));
        let mut split = self.scratch.split.take().unwrap_or_default();
        split.t = t;
        self.local.star(t, &mut self.scratch.star);
        split.fan.sort(&self.scratch.star, self.local.vertices.len());
        self.labels(&mut split)?;
        find_cuts(&mut split);
        self.faces(&mut split, new_faces)?;
        self.grow(&mut split);

        let u = split.u;
        let actual = self.guide.as_ref().map(|g| (g.source.place)(g.new_vertex()));
        let shift = self.shift(GridOwner::New, self.resolution.shift, actual.map_or(0, |a| a.shift));
        let end = |i: usize| split.added.get(i).map(|a| a.x);
        let roles = Roles { target: t, ends: [end(0), end(1)] };
        let mut star = std::mem::take(&mut self.scratch.star);
        if !star_of_new(&split, &mut star) {
            self.local.star(u, &mut star);
        }
        self.local.vertices[u as usize].shift = shift;
        let position = self.position(u, &star, roles, shift, actual.map(|a| a.cell))?;
        self.local.place_vertex(u, &star, position);
        if self.mesh.kinds.skins {
            self.skin(t, &star)?;
        }
        self.scratch.star = star;
        self.wedges(&split)?;
        self.coder.check()?;
        self.scratch.split = Some(split);
        Ok(u)
    }

    /// Codes the skin of the new vertex, expected from the one that it splits from and from its neighbours.
    fn skin(&mut self, t: u32, star: &[StarFace]) -> Result<(), DecodeError> {
        let mut expected = ExpectedSkin::near(self.local.skin(t));
        for star_face in star.iter().filter(|star_face| star_face.a != t) {
            expected.add(self.local.skin(star_face.a));
        }
        let want = self.guide.as_ref().map(|g| g.source.skin(g.new_vertex()));
        let skin = code_skin(self.coder, &expected, want)?;
        self.local.new_skins.push(skin);
        Ok(())
    }

    /// Codes which star faces move to the new vertex.
    fn labels(&mut self, split: &mut Split) -> Result<(), DecodeError> {
        let Split { t, ref fan, ref mut moving, ref mut moves, ref mut run, .. } = *split;
        let n = fan.star_faces.len();
        let guide = self.guide.as_ref();
        let wanted: Option<Vec<bool>> =
            guide.map(|g| fan.star_faces.iter().map(|s| g.moves(s.face)).collect());
        moving.clear();
        *run = None;
        if fan.segments.len() == 1 {
            let closed = fan.segments[0].closed;
            let Scratch { ring, starts: runs, .. } = &mut self.scratch;
            runs.measure(&self.local, fan, t, ring);
            let want = wanted.as_ref().map(|w| single_run(w, closed));
            if self.coder.bit(SINGLE_RUN + usize::from(closed), want.as_ref().is_some_and(Option::is_some)) {
                let (start, length) = want.flatten().unwrap_or((0, 0));
                let length = code_length(self.coder, n, closed, length)?;
                let starts = match length {
                    0 => 0,
                    _ if closed && length == n => 1,
                    _ if closed => n,
                    _ => n - length + 1,
                };
                let mut at = 0;
                if starts > 1 {
                    runs.score(fan, length, starts, ring);
                    at = runs.code(self.coder, n, wanted.is_some().then_some(start))?;
                }
                // A run of a closed star may wrap around the end of the list.
                let (over, end) = ((at + length).saturating_sub(n), (at + length).min(n));
                (0..over).chain(at..end).for_each(|i| moving.push(i));
                *run = Some((at, length));
                return Ok(());
            }
        }
        moves.clear();
        let mut previous = false;
        for i in 0..n {
            let want = wanted.as_ref().is_some_and(|w| w[i]);
            previous = self.coder.bit(LABEL + usize::from(previous), want);
            moves.push(previous);
            if previous {
                moving.push(i);
            }
        }
        Ok(())
    }

    /// Codes the faces that the split adds.
    fn faces(&mut self, split: &mut Split, mut new_faces: Vec<SplitFace>) -> Result<(), DecodeError> {
        let Split { t, fan, cuts, added, .. } = split;
        added.clear();
        for (number, cut) in cuts.iter().enumerate() {
            let found = new_faces.iter().position(|b| b.x == cut.x && b.left == cut.left);
            let context = usize::from(cut.stays.is_some()) * 2 + usize::from(cut.left);
            if self.coder.bit(CUT + context, found.is_some()) {
                let face = found.map(|i| new_faces.remove(i).face);
                added.push(AddedFace { x: cut.x, left: cut.left, cut: Some(number), local: 0, face });
            }
        }
        let extras = integer(self.coder, EXTRAS, id32(new_faces.len()));
        if extras > MAX_EXTRAS {
            return Err(DecodeError::new("chunk", format!("a split adds {extras} faces")));
        }
        let ring = if extras > 0 { fan.ring() } else { Vec::new() };
        for i in 0..extras as usize {
            let want = new_faces.get(i);
            let place = want.and_then(|w| ring.iter().position(|&v| v == w.x));
            let x = if !ring.is_empty() && self.coder.bit(EXTRA_IN_RING, place.is_some()) {
                ring[index(self.coder, ring.len(), place.unwrap_or(0), "chunk: ring vertex")?]
            } else {
                let want = want.map_or(0, |w| w.x as usize);
                id32(index(self.coder, self.local.vertices.len(), want, "chunk: vertex")?)
            };
            if x == *t {
                return Err(DecodeError::new("chunk", "a face uses a vertex twice"));
            }
            let left = self.coder.raw(1, u32::from(want.is_some_and(|w| w.left))) == 1;
            added.push(AddedFace { x, left, cut: None, local: 0, face: want.map(|w| w.face) });
            self.coder.check()?;
        }
        Ok(())
    }

    /// Adds the new vertex and its faces. Its position is the old vertex's until coded.
    fn grow(&mut self, split: &mut Split) {
        let (local, t) = (&mut self.local, split.t);
        let u = local.add_vertex(local.position(t), Some(t), 0);
        split.u = u;
        if let Some(guide) = self.guide.as_mut() {
            let name = guide.new_vertex();
            guide.names.vertex(name);
        }
        split.targets.clear();
        split
            .targets
            .extend(split.fan.star_faces.iter().map(|star_face| local.wedge(star_face.face, star_face.k)));
        local.move_corners(split.moving.iter().map(|&i| &split.fan.star_faces[i]), t, u);
        for face in &mut split.added {
            face.local = local.add_face(if face.left { [t, face.x, u] } else { [u, face.x, t] });
            if let (Some(guide), Some(name)) = (self.guide.as_mut(), face.face) {
                guide.names.faces.push(name);
            }
        }
    }
}

/// The star of the new vertex, newest face first, in the order of [`Local::star`](crate::codec::local::Local::star).
/// Returns false if it must be gathered instead, because a face may repeat the old vertex.
fn star_of_new(split: &Split, star: &mut Vec<StarFace>) -> bool {
    let Split { t, fan, moving, added, .. } = split;
    star.clear();
    star.extend(added.iter().rev().map(|&AddedFace { x, left, local: face, .. }| match left {
        true => StarFace { face, k: 2, a: *t, b: x },
        false => StarFace { face, k: 0, a: x, b: *t },
    }));
    // Moved faces come in fan order, before the new faces.
    let mut once = true;
    star.extend(moving.iter().rev().map(|&i| {
        let star_face = fan.star_faces[i];
        once &= star_face.a != *t && star_face.b != *t;
        star_face
    }));
    once
}

fn code_length<C: Coder>(coder: &mut C, n: usize, closed: bool, length: usize) -> Result<usize, DecodeError> {
    let length = if n <= 15 {
        let at = RUN_LENGTH + (n.min(MAX_VALENCE) * 2 + usize::from(closed)) * tree_contexts(4);
        tree(coder, at, 4, id32(length))
    } else {
        integer(coder, LONG_RUN, id32(length))
    } as usize;
    if length > n {
        return Err(DecodeError::new("chunk", "more faces move than there are"));
    }
    Ok(length)
}

/// The only run of moving star faces, as (start, length), if there is at most one.
fn single_run(moves: &[bool], closed: bool) -> Option<(usize, usize)> {
    let n = moves.len();
    let length = moves.iter().filter(|&&m| m).count();
    if length == 0 || length == n {
        return Some((0, length));
    }
    let starts: Vec<usize> = (0..n)
        .filter(|&i| moves[i] && if i == 0 { !(closed && moves[n - 1]) } else { !moves[i - 1] })
        .collect();
    (starts.len() == 1).then(|| (starts[0], length))
}

/// Expected places of new faces: both ends of each run of moving star faces.
fn find_cuts(split: &mut Split) {
    let Split { fan, moves, cuts, run, .. } = split;
    cuts.clear();
    if let Some((start, length)) = *run {
        return cut_run(fan, start, length, cuts);
    }
    for segment in &fan.segments {
        let (start, end) = (segment.start, segment.end);
        for i in (start..end).filter(|&i| moves[i]) {
            let before = if i > start { Some(i - 1) } else { segment.closed.then_some(end - 1) };
            let after = if i + 1 < end { Some(i + 1) } else { segment.closed.then_some(start) };
            if before.is_none_or(|j| !moves[j]) {
                cuts.push(Cut { x: fan.star_faces[i].a, left: true, stays: before, moves: i });
            }
            if after.is_none_or(|j| !moves[j]) {
                cuts.push(Cut { x: fan.star_faces[i].b, left: false, stays: after, moves: i });
            }
        }
    }
}

/// As [`find_cuts`], for one run in a fan of one segment.
fn cut_run(fan: &Fan, start: usize, length: usize, cuts: &mut Vec<Cut>) {
    let (n, closed) = (fan.star_faces.len(), fan.segments[0].closed);
    if length == 0 || (closed && length == n) {
        return;
    }
    let reaches_over = start + length > n;
    let last = if reaches_over { start + length - n } else { start + length } - 1;
    let (before, after) = if closed {
        (Some(if start == 0 { n - 1 } else { start - 1 }), Some(if last + 1 == n { 0 } else { last + 1 }))
    } else {
        (start.checked_sub(1), Some(last + 1).filter(|&after| after < n))
    };
    let first = Cut { x: fan.star_faces[start].a, left: true, stays: before, moves: start };
    let second = Cut { x: fan.star_faces[last].b, left: false, stays: after, moves: last };
    // In list order.
    cuts.extend(if reaches_over { [second, first] } else { [first, second] });
}
