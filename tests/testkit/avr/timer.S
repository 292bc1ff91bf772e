; Timer1 through its registers; results in SRAM from 0x100.
.include "defs.inc"
.ifndef CS
.equ CS, 1
.endif
    ldi r26, 0x00
    ldi r27, 0x01
    ; TCNT1 := 0x12f0 by way of TEMP, then run: the low byte's write is the moment.
    put OCR1AH, 0x13
    put OCR1AL, 0x05
    put TCNT1H, 0x12
    put TCCR1B, CS
    put TCNT1L, 0xf0
    ; TEMP gets another value; reading the low byte brings the counter's high byte into it, where it
    ; stays although the counter goes on.
    put OCR1BH, 0x77
    .rept 11
    nop
    .endr
    lds r17, TCNT1L
    .rept 300
    nop
    .endr
    lds r18, TCNT1H
    st X+, r17
    st X+, r18
    ; The flag stands although its interrupt is off; writing a one clears it.
    in r17, TIFR1_io
    st X+, r17
    sbi TIFR1_io, 1
    in r17, TIFR1_io
    st X+, r17
    ; A match with the value just written is blocked.
    put TCCR1B, 0
    put OCR1BH, 0x20
    put OCR1BL, 0x00
    ldi r16, 4
    out TIFR1_io, r16
    put TCNT1H, 0x20
    put TCNT1L, 0x00
    put TCCR1B, 1
    nop
    nop
    put TCCR1B, 0
    in r17, TIFR1_io
    st X+, r17
    ; Written when the counter stands there by itself it is not.
    lds r18, TCNT1L
    lds r19, TCNT1H
    sts OCR1BH, r19
    sts OCR1BL, r18
    put TCCR1B, 1
    nop
    put TCCR1B, 0
    in r17, TIFR1_io
    st X+, r17
    ldi r17, 0xaa
    st X+, r17
9:  rjmp 9b
