@ Waits for characters on USART1, each of which is an interrupt; with bit 7 set it is a millisecond of work.
 .syntax unified
 .cpu cortex-m4
 .thumb
 .section .vectors,"a"
 .word 0x20010000
 .word reset + 1
 .rept 14 + 37
 .word 0
 .endr
 .word USART1 + 1

 .text
reset:
 ldr r0, =0x40011000    @ USART1
 ldr r1, =1094          @ 42 MHz / 38400
 str r1, [r0, #0x08]    @ BRR
 ldr r1, =0x202C        @ UE, RXNEIE, TE, RE
 str r1, [r0, #0x0C]    @ CR1
 ldr r1, =0xE000E104    @ NVIC ISER1
 mov r2, #1 << 5        @ interrupt 37
 str r2, [r1]
 ldr r4, =0x20000000    @ the character, and bit 8
 mov r5, #0
 str r5, [r4]
again:
 bl multidrop_idle
 ldr r6, [r4]
 str r5, [r4]
 tst r6, #0x80
 beq 2f
 ldr r7, =62500
1: subs r7, #1
 bne 1b
2:
 .include "marked.inc"
 b again

 .global multidrop_idle
 .type multidrop_idle, %function
multidrop_idle:
1: ldr r1, [r4]
 .rept 8
 nop
 .endr
 cmp r1, #0
 beq 1b
 bx lr
 .size multidrop_idle, . - multidrop_idle

@ 6 instructions, and 2 for each of the lowest three bits' number and one.
 .global USART1
 .type USART1, %function
USART1:
 ldr r1, [r0, #0x04]    @ DR
 and r3, r1, #7
1: subs r3, #1
 bpl 1b
 orr r1, #0x100
 str r1, [r4]
 nop
 bx lr
 .size USART1, . - USART1
