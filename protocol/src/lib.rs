//! Messages, framing, limits, sans-IO sessions, selection and scheduling.
