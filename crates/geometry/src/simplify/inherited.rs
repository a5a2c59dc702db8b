//! What is off already of a mesh that others are measured against.

/// How far a mesh is from the input that it stands for, in grid cells, by vertex: no point around one is farther off.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Inherited {
    pub(crate) geometric: Vec<f32>,
    pub(crate) attributes: Vec<f32>,
}

impl Inherited {
    /// Whether nothing is inherited: the mesh is the input.
    pub(crate) fn is_empty(&self) -> bool {
        self.geometric.is_empty()
    }

    /// The most around the given samples, of which the first are the vertices: geometric, and of attributes.
    pub(crate) fn around(&self, samples: &[u32]) -> [f64; 2] {
        [&self.geometric, &self.attributes].map(|errors| {
            let known = samples.iter().map_while(|&s| errors.get(s as usize));
            known.fold(0.0_f64, |most, &error| most.max(f64::from(error)))
        })
    }

    /// The most of all, geometric.
    pub(crate) fn most(&self) -> f64 {
        self.geometric.iter().fold(0.0_f64, |most, &error| most.max(f64::from(error)))
    }
}
