; Does with the EEPROM what the data sheet does not allow for, each once, in the order of the test.
.include "defs.inc"
.equ EECR_io, 0x1f
.equ EEDR_io, 0x20
.equ EEARL_io, 0x21
    rjmp main
    .org 26 * 4
main:
    ldi r16, 0x23
    out EEARL_io, r16
    ldi r16, 0x5a
    out EEDR_io, r16
    sbi EECR_io, 2
    nop
    nop
    nop
    nop
    sbi EECR_io, 1          ; too late for EEMPE
    sbi EECR_io, 2
    sbi EECR_io, 1
    sbi EECR_io, 3          ; EERIE alone: allowed for
    cbi EECR_io, 3
    ldi r16, 8
    out EECR_io, r16        ; EERIE, and a 0 to EEPE
    cbi EECR_io, 1
    out EEARL_io, r16
    sbi EECR_io, 0
9:  rjmp 9b
