//! The order of what a frame does, apart from the window that does it.

/// A frame's steps.
pub(super) trait Steps {
    /// What painting gives.
    type Painted;

    /// Takes what the streaming thread has.
    fn receive(&mut self) -> anyhow::Result<()>;

    /// Moves the camera as far as keys have pushed it.
    fn move_camera(&mut self);

    /// Tells the streaming thread where the camera is. Costs nothing where it knows.
    fn send_view(&mut self);

    /// Draws the picture and shows it.
    fn paint(&mut self) -> anyhow::Result<Self::Painted>;
}

/// Does a frame.
pub(super) fn run<S: Steps>(steps: &mut S) -> anyhow::Result<S::Painted> {
    steps.receive()?;
    steps.move_camera();
    // Before painting: that takes half a second on a software driver, in which the server could be sending.
    steps.send_view();
    let painted = steps.paint()?;
    // The overlay, which is part of the picture, may have changed what is asked for.
    steps.send_view();
    Ok(painted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Recorder {
        camera: u32,
        sent: Option<u32>,
        target: u32,
        painted_after: Option<Option<u32>>,
    }

    impl Steps for Recorder {
        type Painted = ();

        fn receive(&mut self) -> anyhow::Result<()> {
            // The scene begins, and with it there is a camera.
            self.camera = 1;
            Ok(())
        }

        fn move_camera(&mut self) {
            self.camera += 10;
        }

        fn send_view(&mut self) {
            self.sent = Some(self.camera + self.target);
        }

        fn paint(&mut self) -> anyhow::Result<()> {
            self.painted_after = Some(self.sent);
            // Somebody moves a slider of the overlay.
            self.target = 100;
            Ok(())
        }
    }

    /// The server heard of a moved camera only once its frame was on the screen.
    #[test]
    fn the_view_leaves_before_the_frame_is_painted() {
        let mut recorder = Recorder::default();
        run(&mut recorder).unwrap();
        assert_eq!(recorder.painted_after, Some(Some(11)), "the moved camera's view, before painting");
        assert_eq!(recorder.sent, Some(111), "and what the overlay changed, after it");
    }
}
