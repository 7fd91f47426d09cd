/* The toy model in read-only memory. */
    .section .rodata
    .balign 64
    .global model, model_end
model:
    .incbin MODEL
model_end:
    .byte 0
#ifdef __ELF__
    .section .note.GNU-stack, "", %progbits
#endif
