//! Components that repeat an earlier one, such as stones of a wall, dentils of a cornice or leaves. The earlier
//! component's decisions and vertices predict the current one's.

use std::collections::VecDeque;

/// Decisions stored per component; repeated components are small.
const MAX_DECISIONS: usize = 4096;
/// Components stored.
const MAX_PARTS: usize = 16;

/// A component: all faces grown from one seed face.
#[derive(Clone, Debug, Default)]
struct Part {
    /// Index of its first vertex and first wedge.
    first: [usize; 2],
    decisions: Vec<(usize, bool)>,
}

/// The current component and earlier ones.
#[derive(Clone, Debug, Default)]
pub(super) struct Repeats {
    current: Part,
    /// Earlier components, newest first.
    before: VecDeque<Part>,
    /// Indices into `before` of the components whose decisions equal the current ones so far.
    alike: Vec<usize>,
}

impl Repeats {
    /// Starts a component at these vertex and wedge numbers.
    pub(super) fn begin(&mut self, vertices: usize, wedges: usize) {
        let before =
            std::mem::replace(&mut self.current, Part { first: [vertices, wedges], decisions: Vec::new() });
        if !before.decisions.is_empty() {
            self.before.truncate(MAX_PARTS - 1);
            self.before.push_front(before);
        }
        self.alike = (0..self.before.len()).collect();
    }

    /// Which of the [`REPEAT_STATES`](crate::codec::model::REPEAT_STATES) contexts the next decision takes.
    pub(super) fn state(&self, context: usize) -> usize {
        let newest = self
            .alike
            .first()
            .and_then(|&part| self.before[part].decisions.get(self.current.decisions.len()));
        match newest {
            Some(&(same, bit)) if same == context => 1 + usize::from(bit),
            _ => 0,
        }
    }

    /// Records a decision.
    pub(super) fn follow(&mut self, context: usize, bit: bool) {
        let at = self.current.decisions.len();
        let before = &self.before;
        self.alike.retain(|&part| before[part].decisions.get(at) == Some(&(context, bit)));
        if at < MAX_DECISIONS {
            self.current.decisions.push((context, bit));
        }
    }

    /// The vertices in up to two matching components that correspond to a vertex of this one, newest component first.
    pub(super) fn vertex(&self, number: usize) -> [Option<usize>; 2] {
        self.like(0, number)
    }

    /// First vertex of the current component.
    pub(super) fn first_vertex(&self) -> usize {
        self.current.first[0]
    }

    /// As [`Self::vertex`], for wedges.
    pub(super) fn wedge(&self, number: usize) -> [Option<usize>; 2] {
        self.like(1, number)
    }

    fn like(&self, kind: usize, number: usize) -> [Option<usize>; 2] {
        let Some(at) = number.checked_sub(self.current.first[kind]) else { return [None; 2] };
        let mut alike = self.alike.iter().map(|&part| self.before[part].first[kind] + at);
        // A matching component has as many elements; the bound protects against hostile bytes.
        let mut next = || alike.next().filter(|&like| like < self.current.first[kind]);
        [next(), next()]
    }
}
