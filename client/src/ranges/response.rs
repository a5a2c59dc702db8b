//! Status and range of a response.

use std::ops::Range;

/// The `Content-Range` of a response: `bytes START-LAST/TOTAL`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ContentRange {
    /// The bytes that follow.
    pub range: Range<u64>,
    /// Length of the object, if stated.
    pub total: Option<u64>,
}

impl ContentRange {
    /// Parses the header's value; `None` for another unit or an impossible range.
    #[must_use]
    pub fn parse(value: &str) -> Option<Self> {
        let (range, total) = value.trim().strip_prefix("bytes ")?.split_once('/')?;
        let (start, last) = range.split_once('-')?;
        let (start, last) = (start.trim().parse::<u64>().ok()?, last.trim().parse::<u64>().ok()?);
        let total = if total.trim() == "*" { None } else { Some(total.trim().parse().ok()?) };
        let end = last.checked_add(1)?;
        (start < end && total.is_none_or(|total| end <= total)).then_some(Self { range: start..end, total })
    }
}

/// What a response says before its body.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResponseHead {
    /// HTTP status.
    pub status: u16,
    /// Value of `Content-Range`, if there is a valid one.
    pub content_range: Option<ContentRange>,
    /// Whether the body is encoded (`Content-Encoding`), so that its bytes are not the object's.
    pub encoded: bool,
}

/// Why a response cannot be used. Some faults pass by themselves.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum ResponseFault {
    #[error(
        "the server does not answer range requests; use a server that does, such as nginx, Apache or a CDN"
    )]
    NoRanges,
    #[error("the server compresses the bytes of a range; switch compression off for .lss and .lsp files")]
    Encoded,
    #[error("it is not there (status {0}); publish the scene again, or correct the address")]
    Missing(u16),
    #[error("the server refuses access to it (status {0})")]
    Refused(u16),
    #[error("it is shorter than the scene states: it is truncated, or another; publish the scene again")]
    Truncated,
    #[error("the server sent another range than it was asked for")]
    OtherRange,
    #[error("it has {got} bytes, not {stated}: it was replaced or truncated; publish the scene again")]
    OtherLength { got: u64, stated: u64 },
    #[error("the server answers with status {0}")]
    Status(u16),
}

impl ResponseFault {
    /// Whether a later attempt may succeed without anybody's doing.
    pub(super) const fn passes(&self) -> bool {
        matches!(self, Self::Status(_) | Self::OtherRange)
    }
}

/// Checks a response to a request for a range of an object, of `stated` bytes if that is known; gives the range that
/// follows, which may be shorter than requested at the object's end, and the object's length, if known.
pub(super) fn check(
    head: &ResponseHead,
    asked: &Range<u64>,
    stated: Option<u64>,
) -> Result<(Range<u64>, Option<u64>), ResponseFault> {
    match head.status {
        206 => {}
        200 => return Err(ResponseFault::NoRanges),
        404 | 410 => return Err(ResponseFault::Missing(head.status)),
        401 | 403 => return Err(ResponseFault::Refused(head.status)),
        416 => return Err(ResponseFault::Truncated),
        other => return Err(ResponseFault::Status(other)),
    }
    if head.encoded {
        return Err(ResponseFault::Encoded);
    }
    let ContentRange { range, total } = head.content_range.clone().ok_or(ResponseFault::OtherRange)?;
    if let (Some(got), Some(stated)) = (total, stated)
        && got != stated
    {
        return Err(ResponseFault::OtherLength { got, stated });
    }
    let total = total.or(stated);
    let fits = match total {
        Some(total) => range == (asked.start..asked.end.min(total)),
        None => range.start == asked.start && range.end <= asked.end,
    };
    if fits { Ok((range, total)) } else { Err(ResponseFault::OtherRange) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(status: u16, range: &str) -> ResponseHead {
        ResponseHead { status, content_range: ContentRange::parse(range), encoded: false }
    }

    #[test]
    fn content_ranges_are_parsed() {
        let parsed = ContentRange::parse("bytes 5-9/100").unwrap();
        assert_eq!((parsed.range, parsed.total), (5..10, Some(100)));
        assert_eq!(ContentRange::parse("bytes 0-0/*").unwrap().total, None);
        for bad in [
            "",
            "bytes */100",
            "items 0-9/100",
            "bytes 9-5/100",
            "bytes 0-100/100",
            "bytes 0-x/9",
            "bytes 0-18446744073709551615/*",
        ] {
            assert_eq!(ContentRange::parse(bad), None, "{bad}");
        }
    }

    #[test]
    fn other_responses_than_the_range_are_faults() {
        let asked = 10..20;
        assert_eq!(check(&head(206, "bytes 10-19/100"), &asked, Some(100)), Ok((10..20, Some(100))));
        assert_eq!(check(&head(206, "bytes 10-14/15"), &asked, None), Ok((10..15, Some(15))));
        assert_eq!(check(&head(206, "bytes 10-19/*"), &asked, Some(100)), Ok((10..20, Some(100))));
        let fault = |head: &ResponseHead, stated| check(head, &asked, stated).unwrap_err();
        assert_eq!(fault(&head(200, ""), None), ResponseFault::NoRanges);
        assert_eq!(fault(&head(404, ""), None), ResponseFault::Missing(404));
        assert_eq!(fault(&head(403, ""), None), ResponseFault::Refused(403));
        assert_eq!(fault(&head(416, ""), None), ResponseFault::Truncated);
        assert_eq!(fault(&head(503, ""), None), ResponseFault::Status(503));
        assert_eq!(fault(&head(206, ""), None), ResponseFault::OtherRange);
        assert_eq!(check(&head(206, "bytes 10-14/*"), &asked, None), Ok((10..15, None)));
        assert_eq!(fault(&head(206, "bytes 10-20/*"), None), ResponseFault::OtherRange);
        for other in ["bytes 0-9/100", "bytes 10-18/100", "bytes 10-20/100"] {
            assert_eq!(fault(&head(206, other), Some(100)), ResponseFault::OtherRange, "{other}");
        }
        let other = ResponseFault::OtherLength { got: 99, stated: 100 };
        assert_eq!(fault(&head(206, "bytes 10-19/99"), Some(100)), other);
        let encoded = ResponseHead { encoded: true, ..head(206, "bytes 10-19/100") };
        assert_eq!(fault(&encoded, None), ResponseFault::Encoded);
    }
}
