//! Connected components of faces.

/// For each face the number of its connected component, and how many there are, numbered as the faces come.
///
/// Cost: almost linear (disjoint-set forest with path halving).
pub(super) fn connected(vertices: usize, faces: impl Iterator<Item = [u32; 3]> + Clone) -> (Vec<u32>, usize) {
    let mut roots: Vec<u32> = (0..vertices as u32).collect();
    for face in faces.clone() {
        let [a, b, c] = face.map(|vertex| root(&mut roots, vertex));
        let least = a.min(b).min(c);
        [a, b, c].into_iter().for_each(|vertex| roots[vertex as usize] = least);
    }
    let mut numbers = vec![u32::MAX; vertices];
    let mut count = 0;
    let number = |[first, ..]: [u32; 3]| {
        let number = &mut numbers[root(&mut roots, first) as usize];
        if *number == u32::MAX {
            *number = count;
            count += 1;
        }
        *number
    };
    (faces.map(number).collect(), count as usize)
}

/// The root of a vertex.
fn root(roots: &mut [u32], mut at: u32) -> u32 {
    while roots[at as usize] != at {
        roots[at as usize] = roots[roots[at as usize] as usize];
        at = roots[at as usize];
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_that_share_vertices_have_one_number() {
        let faces = [[4, 5, 6], [0, 1, 2], [2, 3, 0], [6, 7, 4], [8, 8, 8], [1, 9, 10]];
        assert_eq!(connected(11, faces.into_iter()), (vec![0, 1, 1, 0, 2, 1], 3));
    }
}
