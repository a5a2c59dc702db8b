//! The error of a reference mesh itself.

/// Distance of a reference mesh from the input it stands for, in grid cells: an upper bound per vertex for the points
/// around it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Inherited {
    pub(crate) geometric: Vec<f32>,
    pub(crate) attributes: Vec<f32>,
}

impl Inherited {
    /// Whether the reference is the input itself.
    pub(crate) fn is_empty(&self) -> bool {
        self.geometric.is_empty()
    }

    /// The largest error around the given samples, of which the first are the vertices: geometric, and of attributes.
    pub(crate) fn around(&self, samples: &[u32]) -> [f64; 2] {
        [&self.geometric, &self.attributes].map(|errors| {
            let known = samples.iter().map_while(|&s| errors.get(s as usize));
            known.fold(0.0_f64, |max_geometric, &error| max_geometric.max(f64::from(error)))
        })
    }

    /// The largest geometric error.
    pub(crate) fn max_geometric(&self) -> f64 {
        self.geometric.iter().fold(0.0_f64, |max_geometric, &error| max_geometric.max(f64::from(error)))
    }
}
