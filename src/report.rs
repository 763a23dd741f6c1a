//! Pictures and exports of finished runs.
