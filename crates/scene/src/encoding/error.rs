//! What can be wrong with encoded bytes.

/// Bytes that do not decode to a value, or a value that cannot be encoded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodingError {
    /// The bytes end early.
    #[error("the bytes end too early")]
    EndsEarly,
    /// A length or count exceeds its limit.
    #[error("a length exceeds its limit")]
    LimitExceeded,
    /// An integer beyond its type, or with an unknown first byte.
    #[error("an integer is out of its type's range")]
    IntegerRange,
    /// An integer in more bytes than it needs.
    #[error("an integer is not in its shortest form")]
    IntegerNotShortest,
    /// A text that is not UTF-8.
    #[error("a text is not UTF-8")]
    Utf8,
    /// A number that is no variant of an enum.
    #[error("unknown variant of {0}")]
    UnknownVariant(&'static str),
    /// A value that its type refuses.
    #[error("{why}")]
    Value {
        /// What is wrong with it.
        why: String,
    },
    /// Bytes are left over.
    #[error("{left} bytes are left over at the end")]
    TrailingBytes {
        /// How many.
        left: usize,
    },
    /// More bytes than allowed.
    #[error("{bytes} bytes, but at most {limit} are allowed")]
    TooLong {
        /// How many.
        bytes: usize,
        /// The greatest allowed number.
        limit: usize,
    },
}

impl CodingError {
    /// A value that its type refuses.
    pub fn value(why: impl ToString) -> Self {
        Self::Value { why: why.to_string() }
    }
}
