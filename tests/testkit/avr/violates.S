; Sends 1, 2 and 3 at 38400, 10 ms after the start, as a node that keeps the rules of the bus, or breaks one of them:
; LEAD, GAP, LAG: cycles (times 4) between DE and the first character, before the third one, between TXC and the end of DE;
; MODE 1: DE ends when the last character begins; 2: no DE; 3: DE without a character; 4: an opcode that is none.
.include "defs.inc"
.ifndef MODE
.equ MODE, 0
.endif
.ifndef LEAD
.equ LEAD, 1
.endif
.ifndef GAP
.equ GAP, 1
.endif
.ifndef LAG
.equ LAG, 1
.endif
.macro wait times
    ldi r24, (\times) & 0xff
    ldi r25, (\times) >> 8
1:  sbiw r24, 1
    brne 1b
.endm
.macro send value
    put UDR0, \value
2:  lds r17, UCSR0A
    sbrs r17, 5
    rjmp 2b
.endm
    sbi DDRD_io, 2
    usart_init 0x08
    wait 40000
.if MODE != 2
    sbi PORTD_io, 2
.endif
    wait LEAD
.if MODE != 3
    send 1
    send 2
    wait GAP
    put UCSR0A, UCSRA + 0x40    ; TXC is that of the second, where it has left
    send 3
.if MODE != 1
3:  lds r17, UCSR0A
    sbrs r17, 6
    rjmp 3b
.endif
.endif
    wait LAG
    cbi PORTD_io, 2
.if MODE == 4
    .word 0x9404
.endif
9:  rjmp 9b
