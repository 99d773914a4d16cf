//! Errors of expressions.

/// Reason for which an expression makes no sense, or does not have the value that is asked for.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ExpressionError {
    /// It cannot be read.
    #[error("{why}")]
    Unreadable {
        /// As it was written.
        expression: String,
        /// Number of its characters before the one from which on it cannot be read.
        at: usize,
        /// Reason, and what is allowed.
        why: String,
    },
    /// It has no sense: names, functions or types are wrong, or it is too long.
    #[error("{why}")]
    Unsound {
        /// As it was written.
        expression: String,
        /// Reason, and what is allowed.
        why: String,
    },
    /// It cannot be evaluated now.
    #[error("`{expression}` has no value: it compares what is not a number, as 0/0")]
    NoValue {
        /// As it was written.
        expression: String,
    },
    /// It is a number where true or false is asked for.
    #[error("`{expression}` is a number, not true or false")]
    NoFlag {
        /// As it was written.
        expression: String,
    },
    /// It is true or false where a number is asked for.
    #[error("`{expression}` is true or false, not a number")]
    NoNumber {
        /// As it was written.
        expression: String,
    },
}
