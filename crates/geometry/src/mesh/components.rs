//! Connected components of a mesh.

/// The smallest vertex of each vertex's connected component, by union–find with path halving (Tarjan and van Leeuwen,
/// "Worst-case analysis of set union algorithms", 1984). Nearly linear.
///
/// # Panics
///
/// If a face has a vertex that is not below `vertices`.
#[must_use]
pub fn components(vertices: usize, faces: &[[u32; 3]]) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..vertices as u32).collect();
    for &[a, b, c] in faces {
        for (p, q) in [(a, b), (b, c)] {
            let (p, q) = (root(&mut parent, p), root(&mut parent, q));
            parent[p.max(q) as usize] = p.min(q);
        }
    }
    (0..vertices as u32).map(|v| root(&mut parent, v)).collect()
}

fn root(parent: &mut [u32], mut v: u32) -> u32 {
    while parent[v as usize] != v {
        let above = parent[parent[v as usize] as usize];
        parent[v as usize] = above;
        v = above;
    }
    v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_share_no_vertex() {
        assert_eq!(components(7, &[[0, 1, 2], [3, 4, 5], [5, 6, 3]]), [0, 0, 0, 3, 3, 3, 3]);
        assert_eq!(components(7, &[[3, 4, 5], [0, 1, 2], [5, 6, 0]]), [0; 7]);
        assert_eq!(components(4, &[[2, 1, 0]]), [0, 0, 0, 3]);
    }
}
