//! Draws packed maps on the GPU and hands the pixels back.
