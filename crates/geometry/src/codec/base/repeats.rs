//! Parts that are like one before: stones of a wall, dentils of a cornice, leaves. What that part decided at the same
//! place, and where its vertices and wedges are, predicts this one's.

use std::collections::VecDeque;

/// Decisions of a part that are kept; what repeats is small.
const MOST_DECISIONS: usize = 4096;
/// Parts that are kept.
const MOST_PARTS: usize = 16;

/// A part: all that grew from one seed face.
#[derive(Clone, Debug, Default)]
struct Part {
    /// Its first vertex and wedge.
    first: [usize; 2],
    decisions: Vec<(usize, bool)>,
}

/// The part that grows, and those before it.
#[derive(Clone, Debug, Default)]
pub(super) struct Repeats {
    now: Part,
    /// The newest first.
    before: VecDeque<Part>,
    /// Those of them that decided all as this one did so far, by place.
    alike: Vec<usize>,
}

impl Repeats {
    /// A part begins at these numbers of vertices and wedges.
    pub(super) fn begin(&mut self, vertices: usize, wedges: usize) {
        let before =
            std::mem::replace(&mut self.now, Part { first: [vertices, wedges], decisions: Vec::new() });
        if !before.decisions.is_empty() {
            self.before.truncate(MOST_PARTS - 1);
            self.before.push_front(before);
        }
        self.alike = (0..self.before.len()).collect();
    }

    /// Which of [`TOLD`](crate::codec::model::TOLD) contexts a decision takes.
    pub(super) fn told(&self, context: usize) -> usize {
        let newest =
            self.alike.first().and_then(|&part| self.before[part].decisions.get(self.now.decisions.len()));
        match newest {
            Some(&(same, bit)) if same == context => 1 + usize::from(bit),
            _ => 0,
        }
    }

    /// Takes note of a decision.
    pub(super) fn follow(&mut self, context: usize, bit: bool) {
        let at = self.now.decisions.len();
        let before = &self.before;
        self.alike.retain(|&part| before[part].decisions.get(at) == Some(&(context, bit)));
        if at < MOST_DECISIONS {
            self.now.decisions.push((context, bit));
        }
    }

    /// The vertices of up to two parts which are like one of this part, that of the newest first.
    pub(super) fn vertex(&self, number: usize) -> [Option<usize>; 2] {
        self.like(0, number)
    }

    /// First vertex of the part.
    pub(super) fn first_vertex(&self) -> usize {
        self.now.first[0]
    }

    /// The same of wedges.
    pub(super) fn wedge(&self, number: usize) -> [Option<usize>; 2] {
        self.like(1, number)
    }

    fn like(&self, kind: usize, number: usize) -> [Option<usize>; 2] {
        let Some(at) = number.checked_sub(self.now.first[kind]) else { return [None; 2] };
        let mut alike = self.alike.iter().map(|&part| self.before[part].first[kind] + at);
        // A part that is alike has as many; the first of this one bounds what hostile bytes say.
        let mut next = || alike.next().filter(|&like| like < self.now.first[kind]);
        [next(), next()]
    }
}
