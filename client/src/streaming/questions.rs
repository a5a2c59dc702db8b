//! Questions of the drawing side to the core on the streaming thread, such as which part a ray meets.

use tokio::sync::{mpsc, oneshot};

use crate::core::ClientCore;

/// Most questions that wait for the streaming thread.
const MAX_QUESTIONS: usize = 16;

type Question = Box<dyn FnOnce(&ClientCore) + Send>;

/// The asking side.
#[derive(Clone, Debug)]
pub(super) struct Asker(mpsc::Sender<Question>);

/// The answering side.
pub(super) struct Questions {
    receiver: mpsc::Receiver<Question>,
    /// Taken from the channel, not answered yet.
    next: Option<Question>,
}

/// An answer that is under way.
#[derive(Debug)]
pub struct Answer<T>(oneshot::Receiver<T>);

impl<T> Answer<T> {
    /// The answer, once it is there; `Err(NoAnswer)` if none will come, because streaming has ended.
    ///
    /// # Errors
    /// None will come.
    pub fn take(&mut self) -> Result<Option<T>, NoAnswer> {
        match self.0.try_recv() {
            Ok(answer) => Ok(Some(answer)),
            Err(oneshot::error::TryRecvError::Empty) => Ok(None),
            Err(oneshot::error::TryRecvError::Closed) => Err(NoAnswer),
        }
    }

    /// Waits for the answer: at most a slice of decoding, about 5 ms, and the question's own work.
    ///
    /// # Errors
    /// None will come.
    pub fn wait(self) -> Result<T, NoAnswer> {
        self.0.blocking_recv().map_err(|_| NoAnswer)
    }
}

/// A question will not be answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("streaming has ended, or too many questions wait for it")]
pub struct NoAnswer;

pub(super) fn channel() -> (Asker, Questions) {
    let (sender, receiver) = mpsc::channel(MAX_QUESTIONS);
    (Asker(sender), Questions { receiver, next: None })
}

impl Asker {
    pub(super) fn ask<T: Send + 'static>(
        &self,
        question: impl FnOnce(&ClientCore) -> T + Send + 'static,
    ) -> Result<Answer<T>, NoAnswer> {
        let (sender, receiver) = oneshot::channel();
        // Fails only if the asker does not want to know any more.
        let question = Box::new(move |core: &ClientCore| drop(sender.send(question(core))));
        self.0.try_send(question).map_err(|_| NoAnswer)?;
        Ok(Answer(receiver))
    }
}

impl Questions {
    /// Waits until there is a question. Never ends once nobody can ask.
    pub(super) async fn wait(&mut self) {
        if self.next.is_some() {
            return;
        }
        match self.receiver.recv().await {
            Some(question) => self.next = Some(question),
            None => std::future::pending().await,
        }
    }

    /// Answers all questions; returns whether there was one.
    pub(super) fn answer(&mut self, core: &ClientCore) -> bool {
        let mut any = false;
        while let Some(question) = self.next.take().or_else(|| self.receiver.try_recv().ok()) {
            question(core);
            any = true;
        }
        any
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::testing::{Loopback, TestScene};

    #[test]
    fn questions_are_answered_in_order_and_a_bounded_number_waits() {
        let mut link = Loopback::new(TestScene::new(2), |_| {});
        link.connect();
        link.settle();
        let (asker, mut questions) = channel();
        let mut answers: Vec<_> =
            (0..MAX_QUESTIONS).map(|n| asker.ask(move |core| (n, core.mesh(1).is_some())).unwrap()).collect();
        assert_eq!(asker.ask(|_| ()).unwrap_err(), NoAnswer);
        assert_eq!(answers[0].take(), Ok(None));
        assert!(questions.answer(&link.core) && !questions.answer(&link.core));
        for (n, answer) in answers.into_iter().enumerate() {
            assert_eq!(answer.wait(), Ok((n, true)));
        }
        let mut late = asker.ask(|_| ()).unwrap();
        drop(questions);
        assert_eq!(late.take(), Err(NoAnswer));
        assert_eq!(asker.ask(|_| ()).unwrap_err(), NoAnswer);
    }
}
