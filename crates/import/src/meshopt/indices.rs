//! Modes TRIANGLES and INDICES.

use super::error::MeshoptError;
use super::reader::Reader;

/// FIFO of the last 16 entries; age 0 is the newest.
struct Fifo<T> {
    entries: [T; 16],
    /// Slot of the next entry.
    next: usize,
}

impl<T: Copy> Fifo<T> {
    fn new(nothing: T) -> Self {
        Self { entries: [nothing; 16], next: 0 }
    }

    fn get(&self, age: usize) -> T {
        self.entries[(self.next + 15 - age) % 16]
    }

    fn push(&mut self, entry: T) {
        self.entries[self.next] = entry;
        self.next = (self.next + 1) % 16;
    }
}

/// State of the triangle decoder.
struct Triangles {
    vertices: Fifo<u32>,
    edges: Fifo<[u32; 2]>,
    /// The next vertex that has not occurred yet.
    next: u32,
    /// The last explicit index.
    last: u32,
}

impl Triangles {
    /// Returns the next vertex that has not occurred yet.
    fn next_vertex(&mut self) -> u32 {
        let next_vertex = self.next;
        self.next = self.next.wrapping_add(1);
        next_vertex
    }

    /// Reads an explicit index: the difference from the last one.
    fn explicit(&mut self, reader: &mut Reader<'_>) -> Result<u32, MeshoptError> {
        let difference = signed(reader.number()?);
        Ok(self.explicit_from(difference))
    }

    fn explicit_from(&mut self, difference: u32) -> u32 {
        self.last = self.last.wrapping_add(difference);
        self.last
    }

    /// A triangle at the edge of an age in the FIFO. The code of its third corner: 0 a new vertex, 1 to 12 one of the
    /// FIFO, 13 or 14 the last explicit index − 1 or + 1, 15 an explicit index.
    fn edge_triangle(
        &mut self,
        age: usize,
        third: usize,
        reader: &mut Reader<'_>,
    ) -> Result<[u32; 3], MeshoptError> {
        let [a, b] = self.edges.get(age);
        let c = match third {
            0 => self.next_vertex(),
            1..13 => self.vertices.get(third),
            13 => self.explicit_from(1_u32.wrapping_neg()),
            14 => self.explicit_from(1),
            _ => self.explicit(reader)?,
        };
        if !(1..13).contains(&third) {
            self.vertices.push(c);
        }
        self.edges.push([c, b]);
        self.edges.push([a, c]);
        Ok([a, b, c])
    }

    /// A triangle without an edge of the FIFO. The code of a corner: 0 a new vertex, 15 an explicit index, else a vertex of
    /// the FIFO.
    fn separate_triangle(
        &mut self,
        corners: [usize; 3],
        reader: &mut Reader<'_>,
    ) -> Result<[u32; 3], MeshoptError> {
        // New and known vertices are resolved before explicit indices are read or anything is pushed.
        let mut triangle = [0; 3];
        for (vertex, corner) in triangle.iter_mut().zip(corners) {
            *vertex = match corner {
                0 => self.next_vertex(),
                15 => 0,
                known => self.vertices.get(known - 1),
            };
        }
        for (vertex, corner) in triangle.iter_mut().zip(corners) {
            if corner == 15 {
                *vertex = self.explicit(reader)?;
            }
        }
        let [a, b, c] = triangle;
        for (vertex, corner) in triangle.into_iter().zip(corners) {
            if corner == 0 || corner == 15 {
                self.vertices.push(vertex);
            }
        }
        self.edges.push([b, a]);
        self.edges.push([c, b]);
        self.edges.push([a, c]);
        Ok(triangle)
    }
}

/// Zigzag decoding: 0, −1, 1, −2, 2 and so on.
fn signed(number: u32) -> u32 {
    (number >> 1) ^ (number & 1).wrapping_neg()
}

/// Writes an index in 2 or 4 bytes.
fn write(bytes: &mut Vec<u8>, index: u32, width: usize) {
    bytes.extend_from_slice(&index.to_le_bytes()[..width]);
}

/// Triangles: one byte for each, what those need besides, and a table of 16 frequent pairs of corners.
pub(super) fn triangles(data: &[u8], count: usize, width: usize) -> Result<Vec<u8>, MeshoptError> {
    let (&head, body) = data.split_first().ok_or(MeshoptError::Truncated)?;
    if head != 0xe1 {
        return Err(MeshoptError::Header(head));
    }
    let (body, table) = body.split_last_chunk::<16>().ok_or(MeshoptError::Truncated)?;
    let (codes, rest) = body.split_at_checked(count / 3).ok_or(MeshoptError::Truncated)?;
    let mut reader = Reader::new(rest);
    let mut known =
        Triangles { vertices: Fifo::new(u32::MAX), edges: Fifo::new([u32::MAX; 2]), next: 0, last: 0 };
    let mut bytes = Vec::with_capacity(count * width);
    for &code in codes {
        let (high, low) = (usize::from(code >> 4), usize::from(code & 15));
        let halves = |byte: u8| [usize::from(byte >> 4), usize::from(byte & 15)];
        let triangle = match code {
            ..0xf0 => known.edge_triangle(high, low, &mut reader)?,
            0xf0..0xfe => {
                let [b, c] = halves(table[low]);
                if b == 15 || c == 15 {
                    return Err(MeshoptError::Channel);
                }
                known.separate_triangle([0, b, c], &mut reader)?
            }
            0xfe.. => {
                let pair = reader.byte()?;
                if pair == 0 {
                    known.next = 0;
                }
                let [b, c] = halves(pair);
                known.separate_triangle([if code == 0xfe { 0 } else { 15 }, b, c], &mut reader)?
            }
        };
        for index in triangle {
            write(&mut bytes, index, width);
        }
    }
    if reader.left() == 0 { Ok(bytes) } else { Err(MeshoptError::TrailingBytes) }
}

/// Indices: each as its difference from the last one of two lines, and which.
pub(super) fn sequence(data: &[u8], count: usize, width: usize) -> Result<Vec<u8>, MeshoptError> {
    let (&head, body) = data.split_first().ok_or(MeshoptError::Truncated)?;
    if head != 0xd1 {
        return Err(MeshoptError::Header(head));
    }
    let (body, _) = body.split_last_chunk::<4>().ok_or(MeshoptError::Truncated)?;
    if body.len() < count {
        return Err(MeshoptError::Truncated);
    }
    let mut reader = Reader::new(body);
    let mut last = [0_u32; 2];
    let mut bytes = Vec::with_capacity(count * width);
    for _ in 0..count {
        let number = reader.number()?;
        let last = &mut last[(number & 1) as usize];
        *last = last.wrapping_add(signed(number >> 1));
        write(&mut bytes, *last, width);
    }
    if reader.left() == 0 { Ok(bytes) } else { Err(MeshoptError::TrailingBytes) }
}
