//! Modes TRIANGLES and INDICES.

use super::damage::Damage;
use super::reader::Reader;

/// Corners and edges that were met last, newest at 0: of 16 entries, overwritten in turn.
struct Recent<T> {
    entries: [T; 16],
    /// Where the next one goes.
    next: usize,
}

impl<T: Copy> Recent<T> {
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

/// What a decoder of triangles knows.
struct Triangles {
    vertices: Recent<u32>,
    edges: Recent<[u32; 2]>,
    /// The first vertex that was not met yet, as encoders number them.
    next: u32,
    /// The index that was last written out.
    last: u32,
}

impl Triangles {
    /// The next vertex that was not met.
    fn fresh(&mut self) -> u32 {
        let fresh = self.next;
        self.next = self.next.wrapping_add(1);
        fresh
    }

    /// An index that is written out, as its difference from the last such.
    fn free(&mut self, reader: &mut Reader<'_>) -> Result<u32, Damage> {
        let difference = signed(reader.number()?);
        Ok(self.free_by(difference))
    }

    fn free_by(&mut self, difference: u32) -> u32 {
        self.last = self.last.wrapping_add(difference);
        self.last
    }

    /// A triangle at the edge that was met `age` edges ago. Its third corner is new (0), met before, the one before or
    /// after the last that was written out (13, 14), or written out (15).
    fn at_edge(&mut self, age: usize, third: usize, reader: &mut Reader<'_>) -> Result<[u32; 3], Damage> {
        let [a, b] = self.edges.get(age);
        let c = match third {
            0 => self.fresh(),
            1..13 => self.vertices.get(third),
            13 => self.free_by(1_u32.wrapping_neg()),
            14 => self.free_by(1),
            _ => self.free(reader)?,
        };
        if !(1..13).contains(&third) {
            self.vertices.push(c);
        }
        self.edges.push([c, b]);
        self.edges.push([a, c]);
        Ok([a, b, c])
    }

    /// A triangle with no such edge. Each corner is 0, a new vertex; 15, one that is written out; or one met before.
    fn apart(&mut self, corners: [usize; 3], reader: &mut Reader<'_>) -> Result<[u32; 3], Damage> {
        // New vertices are counted, and known ones looked up, before anything is written out or pushed.
        let mut triangle = [0; 3];
        for (vertex, corner) in triangle.iter_mut().zip(corners) {
            *vertex = match corner {
                0 => self.fresh(),
                15 => 0,
                known => self.vertices.get(known - 1),
            };
        }
        for (vertex, corner) in triangle.iter_mut().zip(corners) {
            if corner == 15 {
                *vertex = self.free(reader)?;
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

/// Zero, −1, 1, −2, 2 and so on, as their numbers from 0.
fn signed(number: u32) -> u32 {
    (number >> 1) ^ (number & 1).wrapping_neg()
}

/// Writes an index in 2 or 4 bytes.
fn write(bytes: &mut Vec<u8>, index: u32, width: usize) {
    bytes.extend_from_slice(&index.to_le_bytes()[..width]);
}

/// Triangles: one byte for each, what those need besides, and a table of 16 frequent pairs of corners.
pub(super) fn triangles(data: &[u8], count: usize, width: usize) -> Result<Vec<u8>, Damage> {
    let (&head, body) = data.split_first().ok_or(Damage::Short)?;
    if head != 0xe1 {
        return Err(Damage::Header(head));
    }
    let (body, table) = body.split_last_chunk::<16>().ok_or(Damage::Short)?;
    let (codes, rest) = body.split_at_checked(count / 3).ok_or(Damage::Short)?;
    let mut reader = Reader::new(rest);
    let mut known =
        Triangles { vertices: Recent::new(u32::MAX), edges: Recent::new([u32::MAX; 2]), next: 0, last: 0 };
    let mut bytes = Vec::with_capacity(count * width);
    for &code in codes {
        let (high, low) = (usize::from(code >> 4), usize::from(code & 15));
        let halves = |byte: u8| [usize::from(byte >> 4), usize::from(byte & 15)];
        let triangle = match code {
            ..0xf0 => known.at_edge(high, low, &mut reader)?,
            0xf0..0xfe => {
                let [b, c] = halves(table[low]);
                if b == 15 || c == 15 {
                    return Err(Damage::Channel);
                }
                known.apart([0, b, c], &mut reader)?
            }
            0xfe.. => {
                let pair = reader.byte()?;
                if pair == 0 {
                    known.next = 0;
                }
                let [b, c] = halves(pair);
                known.apart([if code == 0xfe { 0 } else { 15 }, b, c], &mut reader)?
            }
        };
        for index in triangle {
            write(&mut bytes, index, width);
        }
    }
    if reader.left() == 0 { Ok(bytes) } else { Err(Damage::Left) }
}

/// Indices: each as its difference from the last one of two lines, and which.
pub(super) fn sequence(data: &[u8], count: usize, width: usize) -> Result<Vec<u8>, Damage> {
    let (&head, body) = data.split_first().ok_or(Damage::Short)?;
    if head != 0xd1 {
        return Err(Damage::Header(head));
    }
    let (body, _) = body.split_last_chunk::<4>().ok_or(Damage::Short)?;
    if body.len() < count {
        return Err(Damage::Short);
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
    if reader.left() == 0 { Ok(bytes) } else { Err(Damage::Left) }
}
