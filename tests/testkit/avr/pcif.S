; The pin-change flag as a start-bit detector: PCIE2 stays 0. PB0 goes up when the flag is seen;
; it is cleared through sbi and PB1 goes up if that cleared it; RXD's level goes to PB2.
.include "defs.inc"
    ldi r16, 7
    out DDRB_io, r16
    ldi r20, 1
    put PCMSK2, 1
    sbi PCIFR_io, 2
1:  sbis PCIFR_io, 2
    rjmp 1b
    out PORTB_io, r20
    sbi PCIFR_io, 2
    sbis PCIFR_io, 2
    sbi PORTB_io, 1
    sbic PIND_io, 0
    sbi PORTB_io, 2
9:  rjmp 9b
