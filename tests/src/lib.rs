//! Host harness of Flashmat: what several test programs share.
