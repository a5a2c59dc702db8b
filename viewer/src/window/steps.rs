//! The order of a frame's steps, independent of the window.

/// A frame's steps.
pub(super) trait Steps {
    /// Result of painting.
    type Painted;

    /// Takes new data from the streaming thread.
    fn receive(&mut self) -> anyhow::Result<()>;

    /// Moves the camera by the keys held.
    fn move_camera(&mut self);

    /// Sends the view to the streaming thread; costs nothing if it is unchanged.
    fn send_view(&mut self);

    /// Draws the picture and shows it.
    fn paint(&mut self) -> anyhow::Result<Self::Painted>;
}

/// Runs the steps of one frame.
pub(super) fn run<S: Steps>(steps: &mut S) -> anyhow::Result<S::Painted> {
    steps.receive()?;
    steps.move_camera();
    // Before painting, which takes half a second on a software driver: the server can send meanwhile.
    steps.send_view();
    let painted = steps.paint()?;
    // The overlay, which is drawn with the picture, may have changed the target.
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
            // The scene arrives, and a camera with it.
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
            // The user moves a slider of the overlay.
            self.target = 100;
            Ok(())
        }
    }

    /// Otherwise the server would receive a moved camera only after its frame is on the screen.
    #[test]
    fn the_view_is_sent_before_the_frame_is_drawn() {
        let mut recorder = Recorder::default();
        run(&mut recorder).unwrap();
        assert_eq!(recorder.painted_after, Some(Some(11)), "the moved camera's view is sent before drawing");
        assert_eq!(recorder.sent, Some(111), "the overlay's change is sent after drawing");
    }
}
