//! Memory along flights: what meshes hold follows what is applied, down as well as up.

use lodestream_scene::description::Camera;
use lodestream_scene::view::View;

use super::{Change, TestScene, view};
use crate::core::testing::Loopback;

/// Assets in a row, three units apart.
const ASSETS: u32 = 6;
/// Bound on memory: about one and a half whole meshes of the row.
const MEMORY_BYTES: u64 = 14 << 20;

/// Bytes of a face in a client's mesh that only grew (measured: 147).
const BYTES_PER_FACE: u64 = 150;

/// A view of one asset from so near that it is refined beyond the bound.
fn over(asset: f64) -> View {
    let target = [3.0 * asset, 0.0, 0.0];
    let eye = [3.0 * asset, 0.8, 1.2];
    view(Camera { eye, target, ..TestScene::new(1).camera() }, 0.05)
}

/// What a client holds: bytes of its meshes, slots of vertices and faces that a renderer has for them, and faces.
#[derive(Clone, Copy, Debug)]
struct Room {
    bytes: u64,
    slots: [u64; 2],
    faces: u64,
}

/// A client whose changes are taken as by a renderer.
struct Flight {
    link: Loopback,
    /// Slots of vertices and faces of each asset.
    slots: Vec<[u64; 2]>,
}

impl Flight {
    fn new() -> Self {
        let mut link = Loopback::new(TestScene::new(ASSETS), |config| config.bound_memory(MEMORY_BYTES));
        link.core.set_view(link.now, over(0.0));
        link.connect();
        Self { link, slots: vec![[0; 2]; ASSETS as usize] }
    }

    /// Settles at a view.
    fn visit(&mut self, asset: f64) -> Room {
        self.link.core.set_view(self.link.now, over(asset));
        for _ in 0..4 {
            self.link.run(20);
            self.take();
        }
        self.link.settle();
        // Compaction waits for changes to be taken.
        for _ in 0..50 {
            self.link.run(1);
            self.take();
        }
        for (asset, slots) in (0..).zip(&self.slots) {
            let Some(mesh) = self.link.core.mesh(asset) else { continue };
            let faces = (0..mesh.material_count()).map(|material| mesh.indices(material).len() as u64).sum();
            assert_eq!(*slots, [mesh.wedge_slots().into(), faces], "a renderer knows the lengths of lists");
        }
        let stats = self.link.core.stats();
        let slots = self.slots.iter().fold([0, 0], |sum, of| [sum[0] + of[0], sum[1] + of[1]]);
        Room { bytes: stats.mesh_bytes, slots, faces: stats.faces }
    }

    fn take(&mut self) {
        for change in self.link.core.take_changes(self.link.now, usize::MAX) {
            if let Change::Mesh(mesh) = change {
                let faces = mesh.index_slots.iter().copied().map(u64::from).sum();
                self.slots[mesh.asset as usize] = [mesh.vertex_slots.into(), faces];
            }
        }
    }
}

/// After many flights along the row and back, a client holds about what one holds that came at once.
#[test]
fn memory_after_long_flights_is_that_of_what_is_applied() {
    let mut flight = Flight::new();
    let last = f64::from(ASSETS - 1);
    let mut undone = 0;
    for swing in 0..6 {
        let place = |along: f64| if swing % 2 == 0 { along } else { last - along };
        for step in 0..=2 * (ASSETS - 1) {
            let room = flight.visit(place(f64::from(step) / 2.0));
            assert!(room.bytes <= 2 * BYTES_PER_FACE * room.faces, "swing {swing}, step {step}: {room:?}");
        }
        let (room, needed) = (flight.visit(place(last)), Flight::new().visit(place(last)));
        println!("swing {swing}: {room:?}, {needed:?} without the flights");
        assert_eq!(room.faces, needed.faces, "swing {swing}");
        assert!(4 * room.bytes <= 5 * needed.bytes, "swing {swing}: {room:?}, needed {needed:?}");
        for (slots, needed) in room.slots.into_iter().zip(needed.slots) {
            assert!(slots <= 2 * needed, "swing {swing}: {room:?}, needed {needed}");
        }
        let core = &mut flight.link.core;
        let stats = core.stats();
        assert_eq!(core.scene.update_mesh_bytes().0, stats.faces);
        assert!(stats.undone > undone, "each flight undoes: {stats:?}");
        undone = stats.undone;
    }
}
