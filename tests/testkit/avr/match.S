; The time of a compare match: PB0 goes up with the write of TCNT1 = 0, PB1 when the flag is seen.
; AT: the compare value; CS: the prescaler.
.include "defs.inc"
.ifndef CS
.equ CS, 1
.endif
.ifndef AT
.equ AT, 200
.endif
    ldi r16, 3
    out DDRB_io, r16
    put OCR1BH, AT >> 8
    put OCR1BL, AT & 0xff
    ldi r20, 1
    ldi r21, 3
    ldi r16, CS
    ldi r17, 0
    sts TCNT1H, r17
    sts TCNT1L, r17
    sts TCCR1B, r16
    out PORTB_io, r20
1:  sbis TIFR1_io, 2
    rjmp 1b
    out PORTB_io, r21
9:  rjmp 9b
