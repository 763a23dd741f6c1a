//! The real menu against a real service.
