//! `run.mcap`: what a run recorded, and how it is written and read.
