; Interrupt timing. TIMER1_COMPA goes off when TCNT1 has passed AT (timer clock = CPU clock).
; MODE 0: awake, in a row of nops. 1: asleep. 2: pending when sei comes, a mark two instructions
; later. 3: sleep with SE = 0. 4: asleep with the I flag off and the receiver on.
; PB0 goes high with the first instruction of the handler, PB1 with that after sei or sleep.
.include "defs.inc"
.ifndef MODE
.equ MODE, 0
.endif
    rjmp main
    .org 11 * 4
    out PORTB_io, r20       ; vector 11, in place of a jump
    reti
    .org 26 * 4
main:
    ldi r16, 0xff
    out SPL_io, r16
    ldi r16, 0x08
    out SPH_io, r16
    ldi r20, 1
    ldi r21, 2
    ldi r16, 3
    out DDRB_io, r16
    put OCR1AH, 0
    put OCR1AL, 100
    put TIMSK1, 2
    put TCCR1B, 1
.if MODE == 0
    sei
    .rept 200
    nop
    .endr
.endif
.if MODE == 1
    ldi r16, 1
    out SMCR_io, r16
    sei
    sleep
    out PORTB_io, r21
.endif
.if MODE == 2
    .rept 150
    nop
    .endr
    sei
    out PORTB_io, r21
    nop
.endif
.if MODE == 3
    sleep
    out PORTB_io, r21
.endif
.if MODE == 4
    put UCSR0B, 0x90
    ldi r16, 1
    out SMCR_io, r16
    sleep
    out PORTB_io, r21
.endif
9:  rjmp 9b
