; Writes 0x5a to EEPROM address 0x23: EEPE follows EEMPE so many cycles later as NOPS and its own two. MODE: EEPM, as it stands
; in EECR. Interrupts are on, and INT0 sees any edge. PB0 up when EEMPE is next, PB1 up behind EEPE.
.include "defs.inc"
.equ EECR_io, 0x1f
.equ EEDR_io, 0x20
.equ EEARL_io, 0x21
.ifndef MODE
.equ MODE, 0
.endif
.ifndef NOPS
.equ NOPS, 0
.endif
    rjmp main
    .org 1 * 4
    reti
    .org 26 * 4
main:
    ldi r16, 0xff
    out SPL_io, r16
    ldi r16, 0x08
    out SPH_io, r16
    ldi r16, 3
    out DDRB_io, r16
    put 0x69, 1             ; EICRA
    sbi 0x1c, 0             ; EIFR
    sbi 0x1d, 0             ; EIMSK
    sei
    ldi r20, 1
    ldi r21, 3
    ldi r16, 0x23
    out EEARL_io, r16
    ldi r16, 0x5a
    out EEDR_io, r16
    ldi r16, MODE
    out EECR_io, r16
    ldi r24, 100
1:  dec r24
    brne 1b
    out PORTB_io, r20
    sbi EECR_io, 2
.rept NOPS
    nop
.endr
    sbi EECR_io, 1
    out PORTB_io, r21
9:  rjmp 9b
