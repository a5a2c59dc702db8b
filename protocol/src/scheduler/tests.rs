//! The scheduler's order and bounds, and its behaviour during reads.

use super::*;
use lodestream_scene::blob::BlobPart;

fn read(id: &BlobId) -> Result<Reading, SourceError> {
    match id.part() {
        Some(BlobPart::Chunk(n)) => Ok(Reading::Ready(Bytes::from(vec![n as u8; 1000]))),
        Some(BlobPart::IndexPage(_)) => Err(SourceError::Unreadable { id: *id, why: "bad hash".into() }),
        _ => Err(SourceError::NotFound(*id)),
    }
}

fn chunk(n: u32) -> Unit {
    Unit::Blob(BlobId::chunk(0, n))
}

/// The numbers of the chunks that pieces belong to, one per piece.
fn drain(scheduler: &mut Scheduler) -> Vec<u32> {
    std::iter::from_fn(|| scheduler.next(400, read))
        .map(|out| match out {
            Outgoing::Piece { piece: BlobPiece { id, .. }, .. } => match id.part() {
                Some(BlobPart::Chunk(n)) => n,
                _ => 999,
            },
            Outgoing::Page { page, .. } => 100 + page,
            Outgoing::Failed { .. } => 998,
        })
        .collect()
}

#[test]
fn urgent_first_then_first_come() {
    let mut scheduler = Scheduler::new(10);
    for (n, priority) in [(1, 5), (2, 7), (3, 5), (4, 9)] {
        assert!(scheduler.want(chunk(n), priority));
    }
    scheduler.want(Unit::Page(0), 6);
    scheduler.want(chunk(3), 8);
    assert_eq!(drain(&mut scheduler), [4, 4, 4, 3, 3, 3, 2, 2, 2, 100, 1, 1, 1]);
    assert!(scheduler.is_empty());
}

#[test]
fn begun_blob_is_overtaken_only_by_the_margin() {
    let mut scheduler = Scheduler::new(10);
    scheduler.want(chunk(1), OVERTAKE);
    let first = scheduler.next(400, read).unwrap();
    assert!(matches!(first, Outgoing::Piece { piece: BlobPiece { offset: 0, total: 1000, .. }, .. }));
    scheduler.want(chunk(2), 2 * OVERTAKE - 1);
    scheduler.want(chunk(3), 2 * OVERTAKE);
    assert_eq!(drain(&mut scheduler), [3, 3, 3, 1, 1, 2, 2, 2]);
}

#[test]
fn pieces_are_contiguous_and_complete() {
    let mut scheduler = Scheduler::new(10);
    scheduler.want(chunk(7), 1);
    let mut received = Vec::new();
    while let Some(Outgoing::Piece { piece, .. }) = scheduler.next(333, read) {
        assert_eq!(piece.offset as usize, received.len());
        received.extend_from_slice(&piece.bytes);
    }
    assert_eq!(received, vec![7; 1000]);
}

#[test]
fn parts_are_sent_once_and_extended_in_the_queue() {
    let mut scheduler = Scheduler::new(10);
    scheduler.want_part(chunk(1), 5, 0..300);
    let mut sent = Vec::new();
    let next = |scheduler: &mut Scheduler, sent: &mut Vec<(u32, u32, u32)>| {
        let Some(Outgoing::Piece { piece, .. }) = scheduler.next(200, read) else { return false };
        sent.push((piece.offset, piece.offset + number(piece.bytes.len()), piece.end));
        true
    };
    next(&mut scheduler, &mut sent);
    // The run has begun: the rest follows as another.
    scheduler.want_part(chunk(1), 6, 0..500);
    scheduler.want_part(chunk(1), 6, 0..700);
    while next(&mut scheduler, &mut sent) {}
    // Not begun: extended.
    scheduler.want_part(chunk(1), 5, 700..800);
    scheduler.want_part(chunk(1), 7, 700..1000);
    while next(&mut scheduler, &mut sent) {}
    assert_eq!(
        sent,
        [
            (0, 200, 300),
            (200, 300, 300),
            (300, 500, 700),
            (500, 700, 700),
            (700, 900, 1000),
            (900, 1000, 1000)
        ]
    );
    scheduler.want_part(chunk(1), 5, 0..300);
    next(&mut scheduler, &mut sent);
    scheduler.want_part(chunk(1), 5, 0..1000);
    assert_eq!(scheduler.cancel(BlobId::chunk(0, 1)), Cancelled::BlobTransfer);
    assert!(scheduler.is_empty(), "the rest goes with its beginning");
}

#[test]
fn cancel_drops_unsent_bytes() {
    let mut scheduler = Scheduler::new(10);
    scheduler.want(chunk(1), 5);
    scheduler.want(chunk(2), 4);
    assert_eq!(scheduler.cancel(BlobId::chunk(0, 2)), Cancelled::Queued);
    assert_eq!(scheduler.cancel(BlobId::chunk(0, 2)), Cancelled::Unknown);
    scheduler.next(400, read);
    assert_eq!(scheduler.cancel(BlobId::chunk(0, 1)), Cancelled::BlobTransfer);
    assert_eq!(scheduler.next(400, read), None);
}

#[test]
fn full_queue_refuses_units_but_accepts_new_priorities() {
    let mut scheduler = Scheduler::new(2);
    assert!(scheduler.want(chunk(1), 1) && scheduler.want(chunk(2), 2));
    assert!(!scheduler.want(chunk(3), 3));
    assert!(scheduler.want(chunk(1), 9));
    assert_eq!(scheduler.peek(), Some((9, chunk(1))));
}

#[test]
fn failed_reads_are_reported_and_skipped() {
    let mut scheduler = Scheduler::new(9);
    scheduler.want(Unit::Blob(BlobId::base(0)), 3);
    scheduler.want(Unit::Blob(BlobId::index_page(0, 0)), 2);
    scheduler.want(chunk(1), 1);
    assert_eq!(
        scheduler.next(400, read),
        Some(Outgoing::Failed { id: BlobId::base(0), reason: RefusedReason::NotFound })
    );
    assert_eq!(
        scheduler.next(400, read),
        Some(Outgoing::Failed { id: BlobId::index_page(0, 0), reason: RefusedReason::Unreadable })
    );
    assert_eq!(drain(&mut scheduler), [1, 1, 1]);
}

#[test]
fn suspended_blobs_are_bounded() {
    let mut scheduler = Scheduler::new(100);
    for n in 0..30 {
        scheduler.want(chunk(n), (n + 1) * OVERTAKE);
        scheduler.next(10, read);
    }
    assert!(scheduler.begun.len() <= MAX_SUSPENDED + 1, "{}", scheduler.begun.len());
}

/// A store whose reads are all pending.
fn slow(_: &BlobId) -> Result<Reading, SourceError> {
    Ok(Reading::Pending)
}

fn done(scheduler: &mut Scheduler, n: u32) {
    scheduler.handle_read(BlobId::chunk(0, n), &Ok(Bytes::from(vec![n as u8; 1000])));
}

fn number_of(next: Option<Outgoing>) -> Option<u32> {
    match next {
        Some(Outgoing::Piece { piece, .. }) => match piece.id.part() {
            Some(BlobPart::Chunk(n)) => Some(n),
            _ => None,
        },
        _ => None,
    }
}

#[test]
fn other_blobs_are_sent_during_a_read() {
    let mut scheduler = Scheduler::new(10);
    for (n, priority) in [(1, 3), (2, 2), (3, 1)] {
        scheduler.want(chunk(n), priority);
    }
    let first_is_slow = |id: &BlobId| if *id == BlobId::chunk(0, 1) { slow(id) } else { read(id) };
    assert_eq!(number_of(scheduler.next(1000, first_is_slow)), Some(2));
    assert_eq!((scheduler.poll_read(), scheduler.poll_read()), (Some(BlobId::chunk(0, 1)), None));
    done(&mut scheduler, 1);
    assert_eq!(number_of(scheduler.next(1000, first_is_slow)), Some(1));
    assert_eq!(number_of(scheduler.next(1000, first_is_slow)), Some(3));
    assert!(scheduler.is_empty());
}

#[test]
fn reads_are_bounded_and_not_repeated() {
    let mut scheduler = Scheduler::new(100);
    for n in 0..50 {
        scheduler.want(chunk(n), 100 - n);
    }
    let mut asked = Vec::new();
    for _ in 0..20 {
        assert_eq!(scheduler.next(400, slow), None);
        asked.extend(std::iter::from_fn(|| scheduler.poll_read()));
    }
    assert_eq!(asked, (0..MAX_READS as u32).map(|n| BlobId::chunk(0, n)).collect::<Vec<_>>());
    assert!(!scheduler.has_ready_work() && !scheduler.is_empty());
    assert_eq!(scheduler.queued(), 50 - MAX_READS);
    // Pages of the scene need no store, but come in their turn.
    scheduler.want(Unit::Page(0), 1000);
    assert_eq!(scheduler.next(400, slow), Some(Outgoing::Page { page: 0, priority: 1000 }));
}

#[test]
fn blob_cancelled_during_its_read_may_be_requested_again() {
    let mut scheduler = Scheduler::new(100);
    let id = BlobId::chunk(0, 1);
    scheduler.want(chunk(1), 5);
    assert_eq!(scheduler.next(400, slow), None);
    assert_eq!(scheduler.poll_read(), Some(id));
    assert_eq!(scheduler.cancel(id), Cancelled::Queued);
    assert!(scheduler.is_empty() && !scheduler.contains(&chunk(1)));
    // A new request reuses the outstanding read.
    scheduler.want_part(chunk(1), 6, 0..300);
    assert_eq!((scheduler.next(400, slow), scheduler.poll_read()), (None, None));
    scheduler.want_part(chunk(1), 6, 0..500);
    done(&mut scheduler, 1);
    let Some(Outgoing::Piece { piece, .. }) = scheduler.next(1000, slow) else { panic!("no piece") };
    assert_eq!((piece.offset, piece.end, piece.bytes.len()), (0, 500, 500));
    // After a final cancellation the result is dropped.
    scheduler.want(chunk(2), 5);
    assert_eq!(scheduler.next(400, slow), None);
    assert_eq!(scheduler.poll_read(), Some(BlobId::chunk(0, 2)));
    scheduler.retain(|_| false);
    done(&mut scheduler, 2);
    assert_eq!(scheduler.next(400, slow), None);
    assert!(scheduler.is_empty() && scheduler.reads.has_room());
}

#[test]
fn begun_blob_continues_while_the_next_are_read() {
    let mut scheduler = Scheduler::new(100);
    scheduler.want(chunk(1), OVERTAKE);
    assert_eq!(number_of(scheduler.next(100, read)), Some(1));
    scheduler.want(chunk(2), 2 * OVERTAKE);
    scheduler.want(chunk(3), 3);
    assert_eq!(number_of(scheduler.next(100, slow)), Some(1));
    assert_eq!(number_of(scheduler.next(100, slow)), Some(1));
    let asked: Vec<_> = std::iter::from_fn(|| scheduler.poll_read()).collect();
    assert_eq!(asked, [BlobId::chunk(0, 2), BlobId::chunk(0, 3)]);
    done(&mut scheduler, 3);
    assert_eq!(number_of(scheduler.next(100, slow)), Some(1));
    done(&mut scheduler, 2);
    assert_eq!(number_of(scheduler.next(1000, slow)), Some(2));
    assert_eq!(number_of(scheduler.next(1000, slow)), Some(1));
    assert_eq!(number_of(scheduler.next(1000, slow)), Some(3));
}

#[test]
fn failed_reads_are_reported_in_order() {
    let mut scheduler = Scheduler::new(10);
    let id = BlobId::chunk(0, 1);
    scheduler.want(chunk(1), 5);
    assert_eq!(scheduler.next(400, slow), None);
    assert_eq!(scheduler.poll_read(), Some(id));
    scheduler.handle_read(id, &Err(SourceError::Unreadable { id, why: "the disk is gone".into() }));
    assert_eq!(scheduler.next(400, slow), Some(Outgoing::Failed { id, reason: RefusedReason::Unreadable }));
    assert!(scheduler.is_empty());
}
