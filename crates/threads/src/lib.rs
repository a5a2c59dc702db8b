//! What the platform provides: threads, tasks beside the calling thread, and the time. The one place that differs between
//! a system with threads and a browser's WebAssembly without them, where a pool has one thread, a task runs when its
//! result is first asked for, and the time is that of `performance.now()`.
//!
//! `geometry`, which starts no threads, takes any [`Pool`](lodestream_geometry::pool::Pool) from its caller.

mod pool;
mod task;

pub use pool::Threads;
pub use task::Task;
pub use web_time::Instant;

#[cfg(test)]
mod tests {
    use super::Task;

    #[test]
    fn a_task_gives_its_result_once() {
        let task = Task::start("sum", || (1..=10).sum::<u32>()).unwrap();
        assert_eq!(task.finish(), Some(55));
    }

    #[test]
    fn a_task_that_panics_has_no_result() {
        let task = Task::start("fault", || -> u32 { std::panic::resume_unwind(Box::new(())) }).unwrap();
        assert_eq!(task.finish(), None);
    }
}
